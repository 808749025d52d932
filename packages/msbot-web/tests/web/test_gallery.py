"""Robots and worlds: who may change a demo's robot, what ends by it, and that nothing ends for nothing."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from msbot.operations.rights import Role
from msbot_school.demo.gallery import GALLERY, ROVER, DemoChoice
from msbot_web.access.accounts import NotAllowed
from msbot_web.gallery import AskFirst, ChangeWish, Gallery, RunningDemo
from tests.web.rig import Rig, refusal, show

pytest.importorskip("pymunk", reason="pip install 'msbot[arena]'")
LINE = DemoChoice("buggy", "line")


def gallery_of(rig: Rig, wishes: list[ChangeWish]) -> Gallery:
    """The gallery of a demo that runs the rover."""
    service = rig.service
    return Gallery(
        RunningDemo(ROVER, wishes.append),
        rig.stage.operations,
        service.learning,
        rig.views,
        require=rig.accounts.require,
        asker=service.asker,
    )


def test_a_robot_that_is_no_demo_stays_what_it_is(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        gallery, teacher = rig.service.gallery, rig.session(Role.TEACHER)
        assert gallery.now is None
        assert not gallery.may_change(teacher)
        said = await refusal(lambda: gallery.change(teacher, LINE, agreed=True))
        assert str(said) == "only the demo changes its robot: start another one with msbot demo --world line"

    show(tmp_path, scene)


@pytest.mark.promise("Only a teacher changes a demo's robot, and only after having read what ends")
def test_only_teachers_change_the_robot_and_are_told_first_what_ends(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        wishes: list[ChangeWish] = []
        gallery = gallery_of(rig, wishes)
        for role in (Role.VIEWER, Role.STUDENT):
            assert not gallery.may_change(rig.session(role))
            wish = partial(gallery.change, rig.session(role), LINE, agreed=True)
            assert isinstance(await refusal(wish), NotAllowed)
        teacher = rig.session(Role.TEACHER)
        assert "programs and parts of people stop: " in gallery.what_ends()[0]
        await rig.act(teacher, "stop", reason="")
        said = await refusal(lambda: gallery.change(teacher, LINE))
        assert isinstance(said, AskFirst)
        assert "STOP holds, and goes on to hold at the other robot" in str(said)
        assert not wishes
        await gallery.change(teacher, LINE, agreed=True)
        assert wishes == [ChangeWish(LINE, "", "teacher")]
        assert gallery.is_changing
        assert "is being changed already" in str(await refusal(lambda: gallery.change(teacher, ROVER, agreed=True)))

    show(tmp_path, scene)


@pytest.mark.parametrize(
    ("choice", "words"),
    [(DemoChoice("tank"), "no sample robot 'tank'"), (DemoChoice("buggy", "../../etc/passwd"), "there is no world")],
)
def test_what_there_is_not_ends_nothing(tmp_path: Path, choice: DemoChoice, words: str) -> None:
    async def scene(rig: Rig) -> None:
        wishes: list[ChangeWish] = []
        gallery = gallery_of(rig, wishes)
        said = await refusal(lambda: gallery.change(rig.session(Role.TEACHER), choice, agreed=True))
        assert words in str(said)
        assert not wishes
        assert not gallery.is_changing

    show(tmp_path, scene)


def test_every_entry_can_be_started_and_its_program_is_there() -> None:
    from msbot.config import SAMPLES
    from msbot.sim.arena.world_reader import shipped_worlds
    from msbot_web.programs.browser_files import examples

    assert {one.choice.world for one in GALLERY} == {"", *shipped_worlds()}
    assert all(one.choice.robot in SAMPLES for one in GALLERY)
    assert {one.example for one in GALLERY} <= {"", *examples()}

"""A class at a running robot: what pupils may do by operations, and what teachers change about that."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from msbot.operations.class_operations import MOST_HANDS, MOST_PUPILS
from msbot.operations.rights import Principal, Right, Role
from msbot.pnp import Group
from tests.operations.stage import AA_IS_A_DIAL, Stage, play

RING = ("AA=DIAL", "BB=EFGH", "CC=WXYZ")


def pupil(name: str) -> Principal:
    """A student who is signed in."""
    return Principal(name, lambda _: None, lambda right: right.least <= Role.STUDENT)


def test_a_group_has_its_slots_for_itself(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        done = await stage.do.group("Red", ["ada"], ["aa"], who="novak")
        assert done.words == "group Red: ada; its slots: AA"
        do = stage.operations.do
        for name, arguments in (
            ("set", {"slot": "aa", "name": "period_s", "value": 2}),
            ("reset", {"slot": "AA", "name": "period_s"}),
            ("publish", {"port": "AA.in", "values": ["1", "x"]}),
            ("let_go", {"port": "AA.in"}),
            ("call", {"port": "AA.echo", "values": ["1", "x"]}),
            ("identify", {"part": "AA"}),
        ):
            words = await stage.refusal(do(name, who=pupil("ben"), **arguments))
            assert words == "slot AA belongs to group Red", name
        assert (await do("set", who=pupil("ada"), slot="AA", name="period_s", value=2)).edit_id
        assert (await do("identify", who=pupil("ben"), part="BB")).words
        assert (await do("set", who="novak", slot="AA", name="period_s", value=3)).edit_id
        await stage.do.group("Blue", ["ben", "ada"], ["AA"], who="novak")  # all that Red had
        assert stage.operations.pupils.groups == (Group("Blue", ("ben", "ada"), ("AA",)),)
        assert stage.registry.class_groups.of(stage.registry.robots.all()[0]) == [
            Group("Blue", ("ada", "ben"), ("AA",))
        ]
        assert "everybody's" in (await stage.do.remove_group("Blue", who="novak")).words
        assert (await do("identify", who=pupil("eve"), part="AA")).words
        assert "no group 'Blue'" in await stage.refusal(stage.do.remove_group("Blue", who="novak"))
        assert "no slot 'XX'" in await stage.refusal(stage.do.group("Blue", [], ["XX"], who="novak"))
        assert "is no name" in await stage.refusal(stage.do.group(" x", [], [], who="novak"))
        assert "needs a pupil or a slot" in await stage.refusal(stage.do.group("Blue", [], [], who="novak"))
        lines = [edit.words for edit in await stage.operations.undoing.read(20) if edit.kind == "class"]
        assert lines[-1] == "group Red: ada; its slots: AA"
        assert len(lines) == 3

    play(tmp_path, scene, AA_IS_A_DIAL, parts=RING)


def test_groups_are_there_again_after_a_start(tmp_path: Path) -> None:
    async def before(stage: Stage) -> None:
        await stage.do.group("Red", ["ada"], ["AA"], who="novak")

    async def after(stage: Stage) -> None:
        assert stage.operations.pupils.groups == (Group("Red", ("ada",), ("AA",)),)

    play(tmp_path, before)
    play(tmp_path, after)


def test_what_a_pupil_drives_by_hand_is_let_go_when_the_class_is_frozen(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        do = stage.operations.do
        own = (await do("set", who=pupil("ada"), slot="AA", name="period_s", value=3)).edit_id
        await do("publish", who=pupil("ada"), port="BB.in", values=["1", "on"], seconds=60)
        await do("publish", who="novak", port="CC.in", values=["1", "on"], seconds=60)
        assert (await stage.do.freeze("look", who="novak")).words.startswith("the class is frozen")
        await asyncio.sleep(1.0)
        assert set(stage.operations.by_hand.held_ports().values()) == {"novak"}
        for name, arguments in (
            ("publish", {"port": "BB.in", "values": ["1", "on"]}),
            ("set", {"slot": "AA", "name": "period_s", "value": 2}),
            ("undo", {"edit": own}),
        ):
            assert await stage.refusal(do(name, who=pupil("ada"), **arguments)) == "the class is frozen by novak: look"
        assert (await do("stop", who=pupil("ada"), reason="")).words
        assert (await do("hand", who=pupil("ada"))).words == "ada asks for help"
        await do("go", who="novak")
        assert stage.operations.pupils.frozen is not None  # GO does not end a freeze
        assert (await stage.do.thaw(who="novak")).words == "the class goes on"
        assert await stage.refusal(stage.do.thaw(who="novak")) == "the class is not frozen"
        assert (await do("set", who=pupil("ada"), slot="AA", name="period_s", value=2)).words

    play(tmp_path, scene, AA_IS_A_DIAL, parts=RING)


@pytest.mark.promise("A pupil leaves neither group, freeze nor take-over, by whatever door")
@pytest.mark.parametrize("before", [0, MOST_PUPILS, 2 * MOST_PUPILS])
def test_a_freeze_ends_what_a_pupil_drives_however_many_have_driven(tmp_path: Path, before: int) -> None:
    async def scene(stage: Stage) -> None:
        do, control = stage.operations.do, stage.operations.pupils
        await do("publish", who=pupil("ada"), port="BB.in", values=["1", "on"], seconds=3600)
        for number in range(before):
            control.drives(f"pupil {number}")
        await do("publish", who=pupil("ben"), port="CC.in", values=["1", "on"], seconds=3600)
        assert len(control._drivers) <= MOST_PUPILS
        await stage.do.freeze("look", who="novak")
        assert stage.operations.by_hand.held_ports() == {}

    play(tmp_path, scene, AA_IS_A_DIAL, parts=RING)


@pytest.mark.promise("A pupil leaves neither group, freeze nor take-over, by whatever door")
def test_what_somebody_drives_by_hand_ends_with_the_right_to_it(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        do, held = stage.operations.do, stage.operations.by_hand.held_ports
        for who, port in (("ada", "BB.in"), ("zed", "CC.in")):
            await do("publish", who=pupil(who), port=port, values=["1", "on"], seconds=3600)
        await stage.do.group("Green", ["ben"], ["BB"], who="novak")  # ada's slot is another group's now
        assert held() == {("CC", "in"): "zed"}
        stage.operations.pupils.forget("zed")  # removed by an administrator
        assert held() == {}
        await do("publish", who="novak", port="CC.in", values=["1", "on"], seconds=3600)
        stage.operations.pupils.end_holds("novak")  # who has another role now
        assert held() == {}

    play(tmp_path, scene, AA_IS_A_DIAL, parts=RING)


def test_a_program_is_taken_over_and_handed_back(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        control = stage.operations.pupils
        assert "no pupil 'ada'" in await stage.refusal(stage.do.take_over("ada", who="novak"))
        control.use_people(lambda: ["ada", "ben"])
        await stage.do.hand(who="ada")
        await stage.do.take_over("ada", who="novak")
        assert control.held("ada") == "novak has taken over the program of ada"
        assert control.held("ben") == ""
        assert not control.hands  # the teacher is there
        words = await stage.refusal(stage.operations.do("identify", who=pupil("ada"), part="AA"))
        assert words == "novak has taken over the program of ada"
        await stage.do.take_over("ada", run=True, who="novak")
        assert control.held("ada") == ""
        answer = (await stage.do.classroom(who="novak")).answer
        assert answer["pupils"] == [
            {"pupil": "ada", "group": "", "slots": [], "runs": False, "held": "", "hand_s": None, "taken_by": "novak"}
        ]
        assert (await stage.do.hand_back("ada", who="novak")).words == "ada has the program back"
        assert "nobody has taken over" in await stage.refusal(stage.do.hand_back("ada", who="novak"))

    play(tmp_path, scene, parts=("AA=ABCD",))


def test_hands_are_up_in_the_order_of_asking_and_bounded(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        for number in range(MOST_HANDS):
            await stage.operations.do("hand", who=f"p{number}")
            await asyncio.sleep(0.01)
        hands = stage.operations.pupils.hands
        assert list(hands)[:2] == ["p0", "p1"]
        assert hands["p0"] > hands["p1"]
        assert "more than 200 hands" in await stage.refusal(stage.operations.do("hand", who="one more"))
        assert (await stage.operations.do("hand", who="p0", down=True)).words == "p0 asks for nothing"
        assert "p0" not in stage.operations.pupils.hands

    play(tmp_path, scene)


@pytest.mark.parametrize("right", [Right.ARRANGE, Right.SET])
def test_settings_that_ros_nodes_set_together_are_checked_too(tmp_path: Path, right: Right) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.group("Red", ["ada"], ["AA"], who="novak")
        who = Principal("ben", lambda _: None, lambda one: one is right)
        deed = stage.operations.set_together("AA", {"period_s": "2"}, who=who)
        if right is Right.ARRANGE:
            assert (await deed).words
        else:
            assert "belongs to group Red" in await stage.refusal(deed)

    play(tmp_path, scene, AA_IS_A_DIAL, parts=RING)

"""The class on the page: lists, tickets, how everybody is, and programs that are looked at and taken over."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from msbot.config import GROUP_ROBOT_TOML, blueprint_toml, for_groups, groups_by_slots, load_library, parse_blueprint
from msbot.operations.rights import Role
from msbot.registry import ProgramRecord, ProgramSource
from msbot_web.access.accounts import NotAllowed
from msbot_web.access.class_list import read_list
from msbot_web.class_controller import ClassController, GroupStatus
from msbot_web.programs.programs import NoProgramStore, ProgramActions
from msbot_xrce.errors import ConfigError, MsbotError
from tests.web.rig import Rig, refusal, show

BLOCKS = '{"msbot":1,"view":"blocks","workspace":{}}'
AS_TEXT = BLOCKS.replace('"view":"blocks"', '"view":"python"')


class Screen:
    """A page Program that a test looks at."""

    def __init__(self) -> None:
        self.name, self.text = "x.py", "x = 1"
        self.done: list[str] = []

    def program(self) -> tuple[str, ProgramSource]:
        return self.name, ProgramSource(self.text, BLOCKS)

    def show(self, text: str) -> None:
        self.text = text

    def run(self) -> None:
        self.done.append("run")

    def stop(self) -> None:
        self.done.append("stop")


class Shelf(NoProgramStore):
    """Programs in memory."""

    def __init__(self) -> None:
        self.kept: dict[str, ProgramSource] = {}

    async def of(self, owner: str) -> Sequence[ProgramRecord]:
        return [ProgramRecord(owner, name, "", 0) for name in self.kept]

    async def source(self, owner: str, name: str, number: int | None = None) -> ProgramSource:  # type: ignore[override]
        return self.kept[name]

    async def store(self, owner: str, name: str, source: ProgramSource) -> int:  # type: ignore[override]
        self.kept[name] = source
        return 1


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("Ada\nBen; Red\n\n Cleo\tBlue \r\n", [("Ada", ""), ("Ben", "Red"), ("Cleo", "Blue")]),
        ("Ada;", [("Ada", "")]),
    ],
)
def test_a_pasted_list_is_read(text: str, found: list[tuple[str, str]]) -> None:
    assert [(name, group) for name, group, _ in read_list(text)] == found


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("Ada\n;Red", "line 2: the name is missing"),
        ("Ada\nBen\nAda;Red", "line 3: 'Ada' is there"),
        ("\n".join(f"p{number}" for number in range(1001)), "more than 1000"),
    ],
)
def test_what_is_wrong_with_a_list_is_said(text: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        read_list(text)


def test_a_robot_for_a_class_has_everything_once_for_each_group() -> None:
    library = load_library()
    made = for_groups(parse_blueprint(GROUP_ROBOT_TOML, library), ["Red", "7b"])
    again = parse_blueprint(blueprint_toml(made), library)
    assert (again.slots, again.bindings) == (made.slots, made.bindings)
    assert groups_by_slots([slot.name for slot in made.slots]) == {
        "Red": ["program_Red", "eyes_Red", "bumper_Red", "wheels_Red", "lamp_Red"],
        "7b": ["program_7b", "eyes_7b", "bumper_7b", "wheels_7b", "lamp_7b"],
    }
    assert groups_by_slots(["left_wheel", "fan", "knob"]) == {}
    for names in ([], ["Red", "Red"], ["Gelb ü"], ["x" * 21], [f"g{number}" for number in range(41)]):
        with pytest.raises(ConfigError):
            for_groups(made, names)


def test_a_list_makes_accounts_groups_and_tickets(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        desk, teacher = rig.service.pupils, rig.session(Role.TEACHER)
        who = rig.service.asker(teacher)
        made = await desk.add(teacher, "Anna; Red\nBen", 7, who)
        assert [(one.name, one.group) for one in made] == [("Anna", "Red"), ("Ben", "")]
        word = made[0].path.partition("word=")[2]
        assert desk.passes.admit(word).name == "Anna"
        assert (await rig.accounts.sign_in("Ben", made[1].password, "1.2.3.4")).role is Role.STUDENT
        assert str(await refusal(lambda: desk.add(teacher, "Cleo\n\nAnna", 7, who))).startswith(
            "line 3: there is a user"
        )
        assert rig.accounts.role_of("Cleo") is None  # all or none
        for name, group in (("Cleo", "red"), ("Dora", "Blue"), ("Emil", "BLUE")):  # a group however it is written
            assert (await desk.add(teacher, f"{name}; {group}", 7, who))[0].group == (
                "Red" if group == "red" else "Blue"
            )
        assert {one.name for one in desk.tickets(teacher, 1)} >= {"Anna", "Ben"}
        assert not any(one.password for one in desk.tickets(teacher, 1))
        assert "tell no groups" in str(await refusal(lambda: desk.make_groups(teacher, who)))
        found = await desk.groups_now(teacher, {"Anna": ()}, frozenset())
        assert found[1] == GroupStatus("Red", ("Anna", "Cleo"), 0, 0, 1, 0, 0.0)
        names = [one.name for one in await desk.now(teacher, "en", {})]
        await rig.service.operations.do("hand", who="student")
        first = (await desk.now(teacher, "en", {}))[0]
        assert first.name == "student" != names[0]

    show(tmp_path, scene)


def test_only_teachers_have_a_class(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        desk, student = rig.service.pupils, rig.session(Role.STUDENT)
        who = rig.service.asker(student)
        for deed in (
            lambda: desk.add(student, "Ada", 1, who),
            lambda: desk.tickets(student, 1),
            lambda: desk.class_ticket(student, 30),
            lambda: desk.waiting(student),
            lambda: desk.let_in(student, ["Ada"]),
            lambda: desk.turn_away(student, "Ada"),
            lambda: desk.make_groups(student, who),
            lambda: desk.now(student, "en", {}),
            lambda: desk.groups_now(student, {}, frozenset()),
            lambda: desk.program(student, "Ada"),
            lambda: desk.write(student, "Ada", "x.py", "x"),
            lambda: desk.show(student, "Ada", "x.py", "x"),
            lambda: desk.keep_as_it_is(student, "Ada"),
            lambda: desk.steer(student, "Ada", run=True),
        ):
            assert isinstance(await refusal(deed), NotAllowed)

    show(tmp_path, scene)


def test_a_program_is_looked_at_taken_over_and_steered(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        service, teacher, pupil = rig.service, rig.session(Role.TEACHER), rig.session(Role.STUDENT)
        shelf, name = Shelf(), pupil.name
        desk = ClassController(rig.accounts, service.operations, service.pupils.passes, shelf, service.learning)
        programs = ProgramActions(shelf, rig.accounts, desk.check_writing)
        assert "no program yet" in str(await refusal(lambda: desk.program(teacher, name)))
        await programs.store(pupil, "x.py", ProgramSource("x = 0", BLOCKS))
        assert await desk.program(teacher, name) == ("x.py", ProgramSource("x = 0", BLOCKS), False)
        screen = Screen()
        closed = desk.opened(name, screen)
        assert await desk.program(teacher, name) == ("x.py", ProgramSource("x = 1", BLOCKS), True)
        for deed in (
            lambda: desk.write(teacher, name, "x.py", "x = 2"),
            lambda: desk.show(teacher, name, "x.py", "x = 2"),
            lambda: desk.keep_as_it_is(teacher, name),
        ):
            assert "take over" in str(await refusal(deed))
        await rig.act(teacher, "take_over", pupil=name)
        await desk.keep_as_it_is(teacher, name)
        assert shelf.kept["x.py"] == ProgramSource("x = 1", BLOCKS)  # what the pupil had is there as before
        desk.show(teacher, name, "x.py", "x = ")
        assert (screen.text, shelf.kept["x.py"].text) == ("x = ", "x = 1")
        await desk.write(teacher, name, "x.py", "x = 2")
        assert screen.text == "x = 2"
        assert shelf.kept["x.py"] == ProgramSource("x = 2", AS_TEXT)  # else the blocks would write over it
        screen.name = "y.py"
        assert "has y.py open now, not x.py" in str(await refusal(lambda: desk.write(teacher, name, "x.py", "x = 3")))
        assert "at most 64 kB" in str(await refusal(lambda: desk.show(teacher, name, "y.py", "x" * 70_000)))
        assert (screen.text, shelf.kept["x.py"].text) == ("x = 2", "x = 2")
        assert "taken over" in str(await refusal(lambda: programs.store(pupil, "x.py", ProgramSource("x = 3"))))
        assert "taken over" in str(await refusal(lambda: programs.remove(pupil, "x.py")))
        desk.steer(teacher, name, run=True)
        desk.steer(teacher, name, run=False)
        assert screen.done == ["run", "stop"]
        closed()
        shelf.kept["x.py"] = ProgramSource("x = 2", BLOCKS)
        await desk.write(teacher, name, "x.py", "x = 4")  # the pupil's page is closed
        assert shelf.kept["x.py"] == ProgramSource("x = 4", AS_TEXT)
        with pytest.raises(MsbotError, match="no page Program open"):
            desk.steer(teacher, name, run=True)
        await rig.act(teacher, "hand_back", pupil=name)
        await programs.store(pupil, "x.py", ProgramSource("x = 3"))

    show(tmp_path, scene)


def test_simulated_parts_of_another_group_are_not_played_with(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        teacher, pupil = rig.session(Role.TEACHER), rig.session(Role.STUDENT)
        await rig.act(teacher, "group", group="Red", pupils=["somebody"], slots=["AA"])
        for deed in (
            lambda: rig.service.operate(pupil, "AA", "turn", 1),
            lambda: rig.service.plug(pupil, "AA", plugged=False),
        ):
            assert "belongs to group Red" in str(await refusal(deed))

    show(tmp_path, scene)

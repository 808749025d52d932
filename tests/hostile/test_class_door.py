"""What a pupil leaves behind, reaches or learns beyond what the class's rules let a pupil do."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from msbot.operations.rights import Role
from msbot.registry import ProgramSource, programs
from msbot.registry.maintenance import database_maintenance
from msbot.sim import SimulatedPart, make_simulator
from msbot_web.access.accounts import MOST_TOKENS
from msbot_web.access.sessions import Session
from msbot_web.api.dependencies import words_for
from msbot_web.simulated.simulated_part_controls import SimulatedPartControls
from msbot_xrce.errors import ConfigError, MsbotError, NotThere
from tests.operations.stage import Stage, play
from tests.operations.test_pupils import pupil
from tests.web.rig import Rig, refusal, show

CLASS = "A pupil leaves neither group, freeze nor take-over, by whatever door"


class Simulators:
    """Simulated parts that are plugged in, or not."""

    def __init__(self, **numbers: str) -> None:
        self.parts: dict[str, SimulatedPart] = {slot: make_simulator(number) for slot, number in numbers.items()}
        self.pulled: set[str] = set()
        self.names = tuple(numbers)

    def is_plugged(self, slot: str) -> bool:
        return slot not in self.pulled

    def uid(self, slot: str) -> bytes:
        return b""

    def plug(self, slot: str) -> None:
        self.pulled.discard(slot)

    def unplug(self, slot: str) -> None:
        self.pulled.add(slot)

    def simulated(self, slot: str) -> SimulatedPart | None:
        return None if slot in self.pulled else self.parts[slot]


async def freeze(rig: Rig, pupil: Session) -> None:
    await rig.act(rig.session(Role.TEACHER), "freeze", reason="look")
    assert "frozen" in str(await refusal(lambda: rig.service.operate(pupil, "AA", "press", value=False)))


async def take_over(rig: Rig, pupil: Session) -> None:
    await rig.act(rig.session(Role.TEACHER), "group", group="Red", pupils=[pupil.name], slots=[])
    await rig.act(rig.session(Role.TEACHER), "take_over", pupil=pupil.name)


async def regroup(rig: Rig, pupil: Session) -> None:
    await rig.act(rig.session(Role.TEACHER), "group", group="Blue", pupils=["eve"], slots=["AA", "BB"])


async def sign_out(rig: Rig, pupil: Session) -> None:
    rig.accounts.sign_out(pupil)


async def change_role(rig: Rig, pupil: Session) -> None:
    await rig.accounts.change_role(pupil.name, "viewer", who="ada")


async def remove(rig: Rig, pupil: Session) -> None:
    await rig.accounts.remove_user(pupil.name, who="ada")


async def pull_out(rig: Rig, pupil: Session) -> None:
    for slot in ("AA", "BB"):
        rig.service.plug(pupil, slot, plugged=False)
        rig.service.plug(pupil, slot, plugged=True)


@pytest.mark.promise(CLASS)
@pytest.mark.parametrize("ends", [freeze, take_over, regroup, sign_out, change_role, remove, pull_out])
def test_what_a_pupil_holds_in_the_simulated_world_is_let_go(
    ends: Callable[[Rig, Session], Awaitable[None]], tmp_path: Path
) -> None:
    robot = Simulators(AA="BUTTON", BB="PILOT")
    bench = SimulatedPartControls(robot)

    async def scene(rig: Rig) -> None:
        student = rig.session(Role.STUDENT)
        rig.service.operate(student, "AA", "press", value=True)
        rig.service.operate(student, "BB", "left_power", 80)
        rig.service.operate(student, "BB", "close", 30)
        await ends(rig, student)
        assert robot.parts["AA"].value("press") is False
        assert robot.parts["BB"].value("left_power") == 0
        assert robot.parts["BB"].value("close") == 30, "what stays where it was put is nobody's to hold"

    show(tmp_path, scene, parts=("CC=WXYZ",), bench=bench)


def test_what_a_teacher_holds_and_who_has_another_session_are_left_alone(tmp_path: Path) -> None:
    robot = Simulators(AA="BUTTON", BB="BUTTON")

    async def scene(rig: Rig) -> None:
        tablet, laptop = rig.session(Role.STUDENT), rig.session(Role.STUDENT)
        rig.service.operate(rig.session(Role.TEACHER), "AA", "press", value=True)
        rig.service.operate(tablet, "BB", "press", value=True)
        rig.accounts.sign_out(laptop)
        assert robot.parts["BB"].value("press") is True
        await rig.act(rig.session(Role.TEACHER), "freeze")
        assert robot.parts["AA"].value("press") is True
        assert robot.parts["BB"].value("press") is False

    show(tmp_path, scene, bench=SimulatedPartControls(robot))


HELD = "What somebody holds by hand is let go when the page, session or API token with which they hold it is gone"


@pytest.mark.promise(HELD)
@pytest.mark.parametrize("role", [Role.STUDENT, Role.TEACHER, Role.ADMINISTRATOR])
def test_what_is_held_is_let_go_with_the_page_session_or_token_that_holds_it(role: Role, tmp_path: Path) -> None:
    robot = Simulators(AA="BUTTON", BB="PILOT")

    async def scene(rig: Rig) -> None:
        def holds(session: Session, page: object | None) -> None:
            for slot, control, value in (("AA", "press", True), ("BB", "left_power", 80)):
                rig.service.operate(session, slot, control, value, on_page=page)

        def held() -> tuple[object, object]:
            return robot.parts["AA"].value("press"), robot.parts["BB"].value("left_power")

        stays, page, other = rig.session(role), object(), object()
        holds(stays, page)
        rig.service.let_go(other)
        assert held() == (True, 80), "another page is closed"
        rig.service.let_go(page)
        assert held() == (False, 0), "the page is closed"

        leaves = rig.session(role)
        holds(leaves, page)
        rig.accounts.sign_out(leaves)
        assert held() == (False, 0), "the session is over; the person has another one"

        token = await rig.accounts.new_token(stays.name, "program", who=stays.name)
        await rig.accounts.new_token(stays.name, "another", who=stays.name)
        program = rig.accounts.by_api_token(token)
        assert program is not None
        holds(program, None)
        await rig.act(program, "publish", port="CC.in", values=["1", "on"], seconds=3600)
        await rig.accounts.remove_token(stays.name, "another", who=stays.name)
        assert held() == (True, 80), "another program's token is taken back"
        await rig.act(program, "publish", port="CC.in", values=["1", "on"], seconds=3600)
        await rig.accounts.remove_token(stays.name, "program", who=stays.name)
        assert held() == (False, 0), "its token is taken back"
        assert rig.stage.operations.by_hand.held_ports() == {}

    show(tmp_path, scene, parts=("CC=WXYZ",), bench=SimulatedPartControls(robot))


@pytest.mark.promise(HELD)
def test_a_token_that_another_program_takes_back_in_the_database_lets_go_too(tmp_path: Path) -> None:
    robot = Simulators(AA="BUTTON")

    async def scene(rig: Rig) -> None:
        token = await rig.accounts.new_token("student", "program", who="student")
        program = rig.accounts.by_api_token(token)
        assert program is not None
        rig.service.operate(program, "AA", "press", value=True)
        rig.accounts.load([replace(one, tokens=()) for one in rig.accounts.users()])
        assert robot.parts["AA"].value("press") is False

    show(tmp_path, scene, bench=SimulatedPartControls(robot))


@pytest.mark.promise(CLASS)
def test_freeze_and_group_hold_for_missions(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        do = stage.operations.do
        await stage.do.group("Red", ["ada"], ["AA"], who="novak")
        acts: tuple[tuple[str, dict[str, object]], ...] = (
            ("repair", {"repair": "plug-in", "at": "AA"}),
            ("repair", {"repair": "plug-in", "at": "aa"}),
            ("answer_mission", {"kind": "unplug", "at": "AA"}),
        )
        for name, given in acts:
            assert await stage.refusal(do(name, who=pupil("ben"), **given)) == "slot AA belongs to group Red"
            assert "without missions" in await stage.refusal(do(name, who=pupil("ada"), **given))
        await stage.do.freeze("look", who="novak")
        frozen: tuple[tuple[str, dict[str, object]], ...] = (
            *acts,
            ("repair", {"repair": "quiet-bus"}),
            ("answer_mission", {"kind": "loss"}),
            ("mission_hint", {}),
        )
        for name, given in frozen:
            assert await stage.refusal(do(name, who=pupil("ada"), **given)) == "the class is frozen by novak: look"
            assert "without missions" in await stage.refusal(do(name, who="novak", **given))

    play(tmp_path, scene)


@pytest.mark.promise("Client keys, addresses and UIDs of parts are shown to teachers only")
def test_a_pupil_learns_by_asking_neither_address_nor_uid_of_a_part(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        stage, student = rig.stage, rig.session(Role.STUDENT)
        await rig.act(rig.session(Role.TEACHER), "group", group="Red", pupils=["eve"], slots=["AA"])
        info = stage.info("AA")
        secrets = info.uid.hex(), info.address, f"{info.client_key:08x}", info.uid.hex(":")
        for word in secrets:
            for operation, argument, more in (("identify", "part", {}), ("set", "slot", {"name": "x", "value": 1})):
                told = []
                for one in (word, "nothing"):
                    error = await refusal(partial(rig.act, student, operation, **{argument: one}, **more))
                    assert isinstance(error, NotThere)
                    told.append([str(error), *rig.views.why(one, by_name=True)])
                assert [line.replace(word, "nothing") for line in told[0]] == told[1]
        stage.plug("AA2", "ABCD")
        stage.plug("AA3", "ABCD")
        await rig.look(2.0)
        for word in ("ABCD", "nothing"):
            words = words_for(student, str(await refusal(partial(rig.act, student, "identify", part=word))))
            assert not [one for one in stage.master.inventory.view(stage.now()) if one.address in words]
            assert not [one for one in stage.master.inventory.view(stage.now()) if one.uid and one.uid.hex() in words]
        assert (await rig.act(student, "identify", part="BB")).words
        assert (await rig.act(rig.session(Role.TEACHER), "identify", part=secrets[0])).words

    show(tmp_path, scene)


BAD_NAMES = (
    ".", "..", "a/b", "a\\b", "x?y", "x#y", "%2e%2e", "a\u200bnn", "ann\u3164", "an\u2800n", "ann\u202e", "ann\n",
    " ann", "ann ", "", "x" * 65, "аnn", "Αnn", "eve\ufe0f",
)  # fmt: skip


@pytest.mark.parametrize("name", BAD_NAMES)
def test_a_name_fits_into_an_address_and_is_told_apart_wherever_names_are_given(name: str, tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        teacher = rig.session(Role.TEACHER)
        for deed in (
            lambda: rig.accounts.add_user(name, Role.STUDENT, "correct horse", who="ada"),
            lambda: rig.accounts.new_token("teacher", name, who="teacher"),
            lambda: rig.accounts.new_ticket("teacher", name, who="teacher"),
            lambda: rig.act(teacher, "group", group=name, pupils=["student"], slots=["AA"]),
            lambda: rig.act(teacher, "group", group="Red", pupils=[name], slots=["AA"]),
        ):
            assert isinstance(await refusal(deed), ConfigError)
        await rig.act(teacher, "group", group="Renée O'Neil-Özgür 3 (7b)", pupils=["Анна Smith"], slots=["AA"])

    show(tmp_path, scene)


def test_a_list_with_a_group_that_cannot_be_lets_nobody_in(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        teacher = rig.session(Role.TEACHER)
        asker, before = rig.service.asker(teacher), rig.service.pupils.pupils()
        assert "looks like 'ann'" in str(await refusal(lambda: rig.service.pupils.add(teacher, "ann\nANN", 1, asker)))
        words = await refusal(lambda: rig.service.pupils.add(teacher, "ann; Red\nben; 7/b", 1, asker))
        assert "cannot stand in an address" in str(words)
        assert rig.service.pupils.pupils() == before

    show(tmp_path, scene)


def test_names_that_look_alike_are_refused_and_old_ones_stay_usable(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        accounts, teacher = rig.accounts, rig.session(Role.TEACHER)
        await accounts.add_user("eva", Role.STUDENT, "correct horse", who="ada")
        await rig.act(teacher, "group", group="Cap", pupils=["eva"], slots=["AA"])
        await accounts.new_token("eva", "cop", who="ada")
        for like in ("Eva", "ＥＶＡ", "EVA"):
            with pytest.raises(MsbotError, match="looks like 'eva'"):
                await accounts.add_user(like, Role.STUDENT, "correct horse", who="ada")
        assert "looks like" in str(await refusal(lambda: accounts.new_token("eva", "сор", who="ada")))
        words = await refusal(lambda: rig.act(teacher, "group", group="Сар", pupils=["eva"], slots=["BB"]))
        assert "looks like" in str(words)
        rig.stage.operations.pupils._pupils.use_groups([])
        old = rig.accounts._users["eva"]
        accounts._users[".."] = replace(old, name="..", tokens=(("..", "0" * 64),))
        await rig.act(teacher, "group", group="Red", pupils=[".."], slots=["AA"])
        await accounts.change_role("..", "viewer", who="ada")
        await accounts.new_token("..", "telephone", who="ada")
        await accounts.remove_token("..", "..", who="ada")
        await accounts.remove_user("..", who="ada")

    show(tmp_path, scene)


def test_a_person_has_so_many_tokens_and_no_more(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        for number in range(MOST_TOKENS):
            await rig.accounts.new_token("teacher", f"robot {number}", who="teacher")
        for more in (rig.accounts.new_token, rig.accounts.new_ticket):
            words = str(await refusal(partial(more, "teacher", "one more", who="teacher")))
            assert words == f"teacher has {MOST_TOKENS} tokens and tickets already: remove one that nobody uses"
        await rig.accounts.remove_token("teacher", "robot 0", who="teacher")
        assert await rig.accounts.new_token("teacher", "one more", who="teacher")

    show(tmp_path, scene)


def test_the_programs_of_a_person_and_of_a_robot_have_an_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(programs, "MOST_OF_PROGRAM", 1000)
    monkeypatch.setattr(programs, "MOST_OF_PERSON", 3000)
    monkeypatch.setattr(programs, "MOST_OF_ALL", 5000)

    async def scene(stage: Stage) -> None:
        kept = stage.registry.programs
        for number in range(9):
            kept.store("ann", "a.py", ProgramSource(f"#{number}" + "ü" * 149, "{}"))  # 302 octets
        assert [one.number for one in kept.versions("ann", "a.py")] == [9, 8, 7], "the oldest have given way"
        kept.store("ann", "big.py", ProgramSource("x" * 1500))
        assert len(kept.versions("ann", "big.py")) == 1, "the newest stays"
        with pytest.raises(ConfigError, match=r"the programs of ann have 0 MB .*: remove one that nobody needs first"):
            kept.store("ann", "more.py", ProgramSource("x" * 700))
        assert [one.name for one in kept.of("ann")] == ["big.py", "a.py"], "nothing has changed"
        kept.store("ben", "b.py", ProgramSource("x" * 2000))
        with pytest.raises(ConfigError, match="all programs of this robot"):
            kept.store("eve", "e.py", ProgramSource("x" * 700))
        kept.remove("ann", "big.py")
        assert kept.store("ann", "more.py", ProgramSource("x" * 700)) == 1
        assert kept.store("eve", "e.py", ProgramSource("x" * 700)) == 1

    play(tmp_path, scene)


def test_a_backup_that_no_page_takes_back_is_said_when_it_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert programs.MOST_OF_ALL <= database_maintenance.MOST_OF_PAGE // 2
    assert database_maintenance.too_large_for_page(database_maintenance.MOST_OF_PAGE) == ""

    async def scene(rig: Rig) -> None:
        administrator = rig.session(Role.ADMINISTRATOR)
        await rig.service.backup(administrator)
        assert not [one for one in await rig.service.edits(10) if one.kind == "restore"]
        monkeypatch.setattr(database_maintenance, "MOST_OF_PAGE", 1000)
        await rig.service.backup(administrator)
        (edit,) = [one for one in await rig.service.edits(10) if one.kind == "restore"]
        assert "`msbot db restore` takes it" in edit.words

    show(tmp_path, scene)

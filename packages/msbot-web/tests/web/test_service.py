"""What a person may do: every deed needs its right at that moment, and does what the operations do."""

from __future__ import annotations

import asyncio
import inspect
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from msbot import doctor
from msbot.operations.operation import ArgumentKind
from msbot.operations.rights import Role
from msbot.operations.table import OPERATIONS
from msbot_web.access.accounts import NotAllowed, SignedOut
from msbot_web.access.class_list import NewAccount
from msbot_web.access.sessions import Session
from msbot_web.models.robot_models import Robot, SlotCard
from msbot_web.sd_card import CardChange
from msbot_web.service import SHARED_S, Service
from msbot_web.stored_data import no_stored_data
from msbot_web.whole_class import CLASS_S
from msbot_xrce.errors import MsbotError, NotThere
from tests.operations.stage import AA_IS_A_DIAL
from tests.web.rig import PASSWORD, Rig, ToyBench, chunks, refusal, show

Deed = Callable[[Service, Session], object]
FINDING = doctor.Finding("x", "x", "x", "x", "x", "x", mending=doctor.Mending("unblock", {"part": "nobody"}))
DEEDS: dict[str, tuple[Role, Deed]] = {
    "figures": (Role.VIEWER, lambda do, who: do.figures(who)),
    "stop all": (Role.TEACHER, lambda do, who: do.whole_class.stop_all(who)),
    "own token": (Role.VIEWER, lambda do, who: do.new_token(who, who.name, "x")),
    "tickets": (Role.TEACHER, lambda do, who: do.tickets(who)),
    "own ticket": (Role.TEACHER, lambda do, who: do.new_ticket(who, who.name, "body")),
    "another's ticket": (Role.ADMINISTRATOR, lambda do, who: do.new_ticket(who, "nobody", "body")),
    "remove own token": (Role.VIEWER, lambda do, who: do.remove_token(who, who.name, "x")),
    "own password": (Role.VIEWER, lambda do, who: do.change_password(who, who.name, "short", None)),
    "operate": (Role.STUDENT, lambda do, who: do.operate(who, "AA", "turn", 1)),
    "plug": (Role.STUDENT, lambda do, who: do.plug(who, "AA", plugged=True)),
    "compare": (Role.TEACHER, lambda do, who: do.blueprint_diff(who, "x")),
    "blueprint": (Role.TEACHER, lambda do, who: do.apply_blueprint(who, "x")),
    "examine": (Role.TEACHER, lambda do, who: do.examine(who, anew=False)),
    "mend": (Role.TEACHER, lambda do, who: do.repair(who, FINDING)),
    "users": (Role.ADMINISTRATOR, lambda do, who: do.users(who)),
    "add user": (Role.ADMINISTRATOR, lambda do, who: do.add_user(who, "x", "viewer", "short")),
    "another's password": (Role.ADMINISTRATOR, lambda do, who: do.change_password(who, "nobody", PASSWORD, None)),
    "own role": (Role.ADMINISTRATOR, lambda do, who: do.change_role(who, who.name, "administrator")),
    "add people": (Role.ADMINISTRATOR, lambda do, who: do.add_people(who, [NewAccount("", Role.VIEWER, PASSWORD, 1)])),
    "changes of people": (Role.ADMINISTRATOR, lambda do, who: do.people_edits(who, 5)),
    "remove user": (Role.ADMINISTRATOR, lambda do, who: do.remove_user(who, "nobody")),
    "another's token": (Role.ADMINISTRATOR, lambda do, who: do.new_token(who, "nobody", "x")),
    "remove another's token": (Role.ADMINISTRATOR, lambda do, who: do.remove_token(who, "nobody", "x")),
    "backup": (Role.ADMINISTRATOR, lambda do, who: do.backup(who)),
    "back up": (Role.ADMINISTRATOR, lambda do, who: do.repair(who, replace(FINDING, mending=doctor.Mending("backup")))),
    "restore": (Role.ADMINISTRATOR, lambda do, who: do.restore(who, chunks(b"no backup"))),
    "card": (Role.ADMINISTRATOR, lambda do, who: do.card(who)),
    "change of the card": (Role.ADMINISTRATOR, lambda do, who: do.change_card(who, CardChange(name="x"))),
    "update of the card": (Role.ADMINISTRATOR, lambda do, who: do.update_card(who, chunks(b"no package"))),
    "former version": (Role.ADMINISTRATOR, lambda do, who: do.card_back(who)),
    "restart of the computer": (Role.ADMINISTRATOR, lambda do, who: do.restart_computer(who)),
}
LEAST = {
    "adopt": Role.TEACHER, "swap": Role.TEACHER, "release": Role.TEACHER, "spare": Role.TEACHER, "window": Role.TEACHER,
    "close_window": Role.TEACHER, "forget_part": Role.TEACHER,
    "block": Role.TEACHER, "unblock": Role.TEACHER, "ignore": Role.TEACHER,
    "set": Role.STUDENT, "reset": Role.STUDENT, "values": Role.VIEWER, "bind": Role.TEACHER, "unbind": Role.TEACHER,
    "apply": Role.TEACHER, "undo": Role.STUDENT, "edits": Role.VIEWER, "stop": Role.VIEWER, "go": Role.TEACHER,
    "stop_report": Role.VIEWER, "identify": Role.STUDENT, "why": Role.VIEWER, "publish": Role.STUDENT,
    "topics": Role.VIEWER, "topic_samples": Role.VIEWER, "log_lines": Role.VIEWER, "publish_topic": Role.STUDENT,
    "call": Role.STUDENT,
    "let_go": Role.STUDENT, "stored": Role.VIEWER, "versions": Role.VIEWER,
    "add_slot": Role.TEACHER, "remove_slot": Role.TEACHER,
    "record": Role.TEACHER, "end_record": Role.TEACHER, "recording": Role.VIEWER,
    "forget_type": Role.TEACHER, "plant_fault": Role.TEACHER, "clear_fault": Role.TEACHER, "faults": Role.TEACHER,
    "simulate": Role.TEACHER, "objects": Role.VIEWER, "start_mission": Role.TEACHER, "stop_mission": Role.TEACHER,
    "answer_mission": Role.STUDENT, "repair": Role.STUDENT, "mission_hint": Role.STUDENT, "mission": Role.VIEWER,
    "mission_report": Role.VIEWER,
    "start_lesson": Role.TEACHER, "stop_lesson": Role.TEACHER,
    "join_lesson": Role.STUDENT, "answer_lesson": Role.STUDENT, "hand": Role.STUDENT, "lesson": Role.VIEWER,
    "who_stops": Role.VIEWER,
    "pause_world": Role.STUDENT, "step_world": Role.STUDENT, "reset_world": Role.STUDENT, "world_speed": Role.STUDENT,
    "put_robot": Role.STUDENT, "world": Role.VIEWER,
    "freeze": Role.TEACHER, "thaw": Role.TEACHER, "take_over": Role.TEACHER, "hand_back": Role.TEACHER,
    "group": Role.TEACHER, "remove_group": Role.TEACHER, "classroom": Role.TEACHER,
}  # fmt: skip
"""Who may do each operation of the table at least; said twice on purpose."""


def _operation(name: str) -> Deed:
    nonsense = {ArgumentKind.NUMBER: 5.0, ArgumentKind.WHOLE: 77, ArgumentKind.FLAG: True, ArgumentKind.TEXTS: ["no"]}
    arguments = {argument.name: nonsense.get(argument.kind, "no") for argument in OPERATIONS[name].arguments}

    def deed(service: Service, session: Session) -> object:
        return service.operations.do(name, who=service.asker(session), **arguments)

    return deed


async def _error_of(deed: Deed, service: Service, session: Session) -> MsbotError | None:
    try:
        done = deed(service, session)
        if inspect.isawaitable(done):
            await done
    except MsbotError as error:
        return error
    return None


def test_every_deed_is_refused_to_lower_roles_and_to_who_is_signed_out(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        operations = {name: (least, _operation(name)) for name, least in LEAST.items()}
        for name, (least, deed) in {**DEEDS, **operations}.items():
            for role in Role:
                session = rig.session(role)
                error = await _error_of(deed, rig.service, session)
                assert isinstance(error, NotAllowed) == (role < least), (name, role, error)
                gone = rig.session(role)
                rig.accounts.sign_out(gone)
                assert isinstance(await _error_of(deed, rig.service, gone), SignedOut), (name, role)

    show(tmp_path, scene, bench=ToyBench("AA"))


def test_all_deeds_are_in_the_table() -> None:
    seeing = {
        "me",
        "may_undo",
        "robot",
        "glance",
        "values",
        "journal",
        "edits",
        "robots",
        "blueprint",
        "has_card",
        "is_on_card",
    }
    deeds = (
        {name for name in vars(Service) if not name.startswith("_")}
        - seeing
        - {"robot_name", "robot_id", "is_stopped", "asker", "now"}
        - {"let_go", "end_pilot"}  # whoever is gone holds nothing, whatever their rights
    )
    named = {word for _, deed in DEEDS.values() for word in deed.__code__.co_names}
    assert deeds <= named
    assert LEAST.keys() == OPERATIONS.keys()


def test_a_role_that_is_taken_away_counts_at_once(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        teacher = rig.session(Role.TEACHER)
        assert (await rig.act(teacher, "window", seconds=5.0)).words
        await rig.service.change_role(rig.session(Role.ADMINISTRATOR), "teacher", "viewer")
        assert isinstance(await refusal(lambda: rig.act(teacher, "close_window")), NotAllowed)
        assert rig.service.me(teacher).rights == ["see", "stop"]

    show(tmp_path, scene)


def test_a_student_takes_back_own_settings_only(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        teacher, student = rig.session(Role.TEACHER), rig.session(Role.STUDENT)
        theirs = (await rig.act(teacher, "set", slot="AA", name="period_s", value=0.5)).edit_id
        assert "teacher" in str(await refusal(lambda: rig.act(student, "undo", edit=theirs)))
        assert "teacher" in str(await refusal(lambda: rig.act(student, "undo", edit=None)))
        own = (await rig.act(student, "set", slot="AA", name="period_s", value=0.4)).edit_id
        assert (await rig.act(student, "undo", edit=own)).words
        placed = (await rig.act(teacher, "release", slot="BB")).edit_id
        assert await refusal(lambda: rig.act(student, "undo", edit=placed))
        assert (await rig.act(teacher, "undo", edit=placed)).words
        assert "no such change" in str(await refusal(lambda: rig.act(student, "undo", edit=4711)))
        edits = await rig.service.edits(10)
        again = (await rig.act(student, "set", slot="AA", name="period_s", value=0.3)).edit_id
        await rig.act(teacher, "stop")
        offered = {}
        for role in Role:
            session = rig.session(role)
            offered[role] = [edit.number for edit in await rig.service.edits(10) if rig.service.may_undo(session, edit)]
        assert offered[Role.VIEWER] == []
        assert offered[Role.STUDENT] == [again]
        assert offered[Role.TEACHER] == [again, theirs]
        assert [(edit.who, edit.undone) for edit in edits if edit.number == own] == [("student", True)]

    show(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL", "BB=EFGH", "CC=WXYZ"))


def test_a_setting_reaches_the_part_and_its_origin_is_told(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        student = rig.session(Role.STUDENT)
        await rig.act(student, "set", slot="AA", name="period_s", value=0.5)
        await asyncio.sleep(0.1)
        assert rig.stage.parts["AA"].settings["period_s"] == "0.5"
        (value,) = await rig.service.values("AA")
        assert (value.value, value.default, value.origin, value.who) == (0.5, 1.0, "hand", "student")
        assert (value.unit, value.least, value.most, value.kind) == ("s", 0.1, 10, "float")
        await rig.act(student, "reset", slot="AA", name="period_s")
        assert (await rig.service.values("AA"))[0].origin != "hand"
        for deed in (
            lambda: rig.service.values("XX"),
            lambda: rig.act(student, "set", slot="XX", name="period_s", value=1),
            lambda: rig.act(rig.session(Role.TEACHER), "swap", slot="XX", to="AA"),
            lambda: rig.service.plug(student, "AA", plugged=True),
        ):
            assert isinstance(await refusal(deed), NotThere)

    show(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


def test_one_look_serves_all_pages_until_somebody_does_something(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        first = rig.service.robot()
        assert rig.service.robot() is first
        await asyncio.sleep(SHARED_S * 1.1)
        second = rig.service.robot()
        assert second is not first
        await rig.act(rig.session(Role.VIEWER), "stop")
        assert rig.service.robot().stopped
        assert not second.stopped
        await rig.act(rig.session(Role.TEACHER), "go")
        assert not rig.service.robot().stopped

    show(tmp_path, scene)


def test_a_robot_that_takes_long_to_work_out_is_shared_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def scene(rig: Rig) -> None:
        service, late, worked_out = rig.service, 0.0, 0
        clock, slots = service._clock, service.views.slots_and_waiting

        def slow_slots() -> tuple[list[SlotCard], int]:
            nonlocal late, worked_out
            late, worked_out = late + 2 * SHARED_S, worked_out + 1
            return slots()

        monkeypatch.setattr(service, "_clock", lambda: clock() + late)
        monkeypatch.setattr(service.views, "slots_and_waiting", slow_slots)
        for _ in range(4):  # the menu, the toasts and the grid of one page, and another page
            service.robot()
        assert worked_out == 1

    show(tmp_path, scene)


def test_the_robot_counts_who_waits_but_not_whom_a_person_ignores(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        rig.stage.plug("spare", "ABCD")
        await asyncio.sleep(1.0)
        assert rig.service.robot().arrivals == 1
        await rig.act(rig.session(Role.TEACHER), "ignore", part="spare")
        assert rig.service.robot().arrivals == 0

    show(tmp_path, scene)


@pytest.mark.promise("A pupil leaves neither group, freeze nor take-over, by whatever door")
def test_a_simulated_part_does_not_lead_a_pupil_into_another_group(tmp_path: Path) -> None:
    bench = ToyBench("AA")

    async def scene(rig: Rig) -> None:
        student, teacher = rig.session(Role.STUDENT), rig.session(Role.TEACHER)
        await rig.act(teacher, "group", group="Red", pupils=["student"], slots=["AA"])
        await rig.act(teacher, "group", group="Blue", pupils=[], slots=["BB"])
        bench.plugged["AA"] = False
        assert "AA has another part now" in str(await refusal(lambda: rig.service.plug(student, "AA", plugged=True)))
        holders = [rig.stage.master.inventory.holder(slot, rig.service.now()) for slot in ("AA", "BB")]
        own, other = (holder.uid for holder in holders if holder is not None)
        bench.uids["AA"] = own  # it was pulled out a moment ago, and is not lost yet
        assert rig.service.plug(student, "AA", plugged=True).words == "AA is plugged in"
        bench.uids["AA"] = other  # it has joined there
        for deed in (
            lambda: rig.service.operate(student, "AA", "turn", 7),
            lambda: rig.service.plug(student, "AA", plugged=False),
        ):
            assert "slot BB belongs to group Blue" in str(await refusal(deed))
        assert rig.service.plug(teacher, "AA", plugged=False).words

    show(tmp_path, scene, bench=bench)


def test_simulated_parts_are_played_with(tmp_path: Path) -> None:
    bench = ToyBench("AA")

    async def scene(rig: Rig) -> None:
        student = rig.session(Role.STUDENT)
        assert rig.service.plug(student, "AA", plugged=False).words == "AA is unplugged"
        assert bench.plugged == {"AA": False}
        rig.service.operate(student, "AA", "turn", 7)
        assert bench.turned == {"AA": 7}
        assert "no control 'x'" in str(await refusal(lambda: rig.service.operate(student, "AA", "x", 1)))

    show(tmp_path, scene, bench=bench)


def test_the_class_view_is_read_every_other_second_at_most(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        first = await rig.service.whole_class.robots()
        rig.stage.pull("AA")
        await asyncio.sleep(CLASS_S / 2)
        assert await rig.service.whole_class.robots() is first
        await asyncio.sleep(CLASS_S)
        assert await rig.service.whole_class.robots() is not first

    show(tmp_path, scene)


def test_people_and_tokens_are_listed_without_their_secrets(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        ada = rig.session(Role.ADMINISTRATOR)
        await rig.service.add_user(ada, "<b>bob", "student", PASSWORD)
        token = await rig.service.new_token(ada, "<b>bob", "desk")
        (line,) = [user for user in rig.service.users(ada) if user.role == "student" and user.name != "student"]
        assert (line.name, line.tokens) == ("<b>bob", ["desk"])
        assert token not in line.model_dump_json()
        assert PASSWORD not in "".join(user.model_dump_json() for user in rig.service.users(ada))

    show(tmp_path, scene)


async def test_a_robot_without_a_database_says_so() -> None:
    robot = Robot(
        name="R",
        version="",
        serial_number="1",
        released="",
        manufacturer="",
        links=[],
        beat_s=1,
        tick_s=2,
        life=3,
        stopped=False,
        window_s=0,
        trouble="",
        slots=[],
        arrivals=0,
    )
    records = no_stored_data(lambda: robot)
    assert await records.journal(10, None, False) == []
    assert [(tile.name, tile.here) for tile in await records.robots()] == [("R", True)]
    for deed in (
        records.export,
        lambda: records.diff("x"),
        lambda: records.apply("x", "y"),
        records.backup,
        lambda: records.restore(chunks(b""), "y"),
    ):
        assert "database" in str(await refusal(deed))

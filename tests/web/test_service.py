"""What a person may do: every deed needs its right at that moment, and does what the operations do."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from pathlib import Path

from msbot.errors import MsbotError
from msbot.web.accounts import NotAllowed, Session, SignedOut
from msbot.web.models import Robot
from msbot.web.roles import Role
from msbot.web.service import CLASS_S, SHARED_S, Service, no_records
from msbot.web.views import NotThere
from tests.operations.stage import AA_IS_A_DIAL
from tests.web.rig import PASSWORD, Rig, ToyBench, refusal, show

Deed = Callable[[Service, Session], object]
DEEDS: dict[str, tuple[Role, Deed]] = {
    "stop": (Role.VIEWER, lambda do, who: do.stop(who, "")),
    "own token": (Role.VIEWER, lambda do, who: do.new_token(who, who.name, "x")),
    "remove own token": (Role.VIEWER, lambda do, who: do.remove_token(who, who.name, "x")),
    "own password": (Role.VIEWER, lambda do, who: do.change_user(who, who.name, None, "short")),
    "identify": (Role.STUDENT, lambda do, who: do.identify(who, "AA")),
    "operate": (Role.STUDENT, lambda do, who: do.operate(who, "AA", "turn", 1)),
    "plug": (Role.STUDENT, lambda do, who: do.plug(who, "AA", plugged=True)),
    "set": (Role.STUDENT, lambda do, who: do.set_value(who, "AA", "no", 1)),
    "reset": (Role.STUDENT, lambda do, who: do.reset_value(who, "AA", "no")),
    "undo": (Role.STUDENT, lambda do, who: do.undo(who, 77)),
    "go on": (Role.TEACHER, lambda do, who: do.go_on(who)),
    "adopt": (Role.TEACHER, lambda do, who: do.adopt(who, "no", "AA")),
    "ignore": (Role.TEACHER, lambda do, who: do.ignore(who, "no")),
    "swap": (Role.TEACHER, lambda do, who: do.swap(who, "AA", "no")),
    "release": (Role.TEACHER, lambda do, who: do.release(who, "AA")),
    "block": (Role.TEACHER, lambda do, who: do.block(who, "no", "")),
    "unblock": (Role.TEACHER, lambda do, who: do.unblock(who, "no")),
    "open window": (Role.TEACHER, lambda do, who: do.open_window(who, 5.0)),
    "close window": (Role.TEACHER, lambda do, who: do.close_window(who)),
    "blueprint": (Role.TEACHER, lambda do, who: do.apply_blueprint(who, "x")),
    "users": (Role.ADMINISTRATOR, lambda do, who: do.users(who)),
    "add user": (Role.ADMINISTRATOR, lambda do, who: do.add_user(who, "x", "viewer", "short")),
    "another's password": (Role.ADMINISTRATOR, lambda do, who: do.change_user(who, "nobody", None, PASSWORD)),
    "own role": (Role.ADMINISTRATOR, lambda do, who: do.change_user(who, who.name, "administrator", None)),
    "remove user": (Role.ADMINISTRATOR, lambda do, who: do.remove_user(who, "nobody")),
    "another's token": (Role.ADMINISTRATOR, lambda do, who: do.new_token(who, "nobody", "x")),
    "remove another's token": (Role.ADMINISTRATOR, lambda do, who: do.remove_token(who, "nobody", "x")),
    "backup": (Role.ADMINISTRATOR, lambda do, who: do.backup(who)),
    "restore": (Role.ADMINISTRATOR, lambda do, who: do.restore(who, b"no backup")),
}


def _error_of(deed: Deed, service: Service, session: Session) -> MsbotError | None:
    try:
        deed(service, session)
    except MsbotError as error:
        return error
    return None


def test_every_deed_is_refused_to_lower_roles_and_to_who_is_signed_out(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        for name, (least, deed) in DEEDS.items():
            for role in Role:
                session = rig.session(role)
                error = _error_of(deed, rig.service, session)
                assert isinstance(error, NotAllowed) == (role < least), (name, role, error)
                gone = rig.session(role)
                rig.accounts.sign_out(gone)
                assert isinstance(_error_of(deed, rig.service, gone), SignedOut), (name, role)

    show(tmp_path, scene, bench=ToyBench("AA"))


def test_all_deeds_are_in_the_table() -> None:
    seeing = {"me", "may_undo", "robot", "values", "journal", "edits", "robots", "blueprint", "blueprint_diff"}
    deeds = {name for name in vars(Service) if not name.startswith("_")} - seeing - {"robot_name"}
    named = {word for _, deed in DEEDS.values() for word in deed.__code__.co_names}
    assert deeds <= named


def test_a_role_that_is_taken_away_counts_at_once(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        teacher = rig.session(Role.TEACHER)
        assert rig.service.open_window(teacher, 5.0).words
        rig.service.change_user(rig.session(Role.ADMINISTRATOR), "teacher", "viewer", None)
        assert isinstance(refusal(lambda: rig.service.close_window(teacher)), NotAllowed)
        assert rig.service.me(teacher).rights == ["see", "stop"]

    show(tmp_path, scene)


def test_a_student_takes_back_own_settings_only(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        teacher, student = rig.session(Role.TEACHER), rig.session(Role.STUDENT)
        theirs = rig.service.set_value(teacher, "AA", "period_s", 0.5).edit
        assert "teacher" in str(refusal(lambda: rig.service.undo(student, theirs)))
        assert "teacher" in str(refusal(lambda: rig.service.undo(student, None)))
        own = rig.service.set_value(student, "AA", "period_s", 0.4).edit
        assert rig.service.undo(student, own).words
        placed = rig.service.release(teacher, "BB").edit
        assert refusal(lambda: rig.service.undo(student, placed))
        assert rig.service.undo(teacher, placed).words
        assert "no such change" in str(refusal(lambda: rig.service.undo(student, 4711)))
        edits = rig.service.edits(10)
        again = rig.service.set_value(student, "AA", "period_s", 0.3).edit
        rig.service.stop(teacher, "")
        offered = {}
        for role in Role:
            session = rig.session(role)
            offered[role] = [edit.number for edit in rig.service.edits(10) if rig.service.may_undo(session, edit)]
        assert offered[Role.VIEWER] == []
        assert offered[Role.STUDENT] == [again]
        assert offered[Role.TEACHER] == [again, theirs]
        assert [(edit.who, edit.undone) for edit in edits if edit.number == own] == [("student", True)]

    show(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL", "BB=EFGH", "CC=WXYZ"))


def test_a_setting_reaches_the_part_and_its_origin_is_told(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        student = rig.session(Role.STUDENT)
        rig.service.set_value(student, "AA", "period_s", 0.5)
        await asyncio.sleep(0.1)
        assert rig.stage.parts["AA"].settings["period_s"] == "0.5"
        (value,) = rig.service.values("AA")
        assert (value.value, value.default, value.origin, value.who) == (0.5, 1.0, "hand", "student")
        assert (value.unit, value.least, value.most, value.kind) == ("s", 0.1, 10, "float")
        rig.service.reset_value(student, "AA", "period_s")
        assert rig.service.values("AA")[0].origin != "hand"
        for deed in (
            lambda: rig.service.values("XX"),
            lambda: rig.service.set_value(student, "XX", "period_s", 1),
            lambda: rig.service.swap(rig.session(Role.TEACHER), "XX", "AA"),
            lambda: rig.service.plug(student, "AA", plugged=True),
        ):
            assert isinstance(refusal(deed), NotThere)

    show(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


def test_one_look_serves_all_pages_until_somebody_does_something(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        first = rig.service.robot()
        assert rig.service.robot() is first
        await asyncio.sleep(SHARED_S * 1.1)
        second = rig.service.robot()
        assert second is not first
        rig.service.stop(rig.session(Role.VIEWER), "")
        assert rig.service.robot().stopped
        assert not second.stopped
        rig.service.go_on(rig.session(Role.TEACHER))
        assert not rig.service.robot().stopped

    show(tmp_path, scene)


def test_the_robot_counts_who_waits_but_not_whom_a_person_ignores(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        rig.stage.plug("spare", "ABCD")
        await asyncio.sleep(1.0)
        assert rig.service.robot().arrivals == 1
        rig.service.ignore(rig.session(Role.TEACHER), "spare")
        assert rig.service.robot().arrivals == 0

    show(tmp_path, scene)


def test_simulated_parts_are_played_with(tmp_path: Path) -> None:
    bench = ToyBench("AA")

    async def scene(rig: Rig) -> None:
        student = rig.session(Role.STUDENT)
        assert rig.service.plug(student, "AA", plugged=False).words == "AA is unplugged"
        assert bench.plugged == {"AA": False}
        rig.service.operate(student, "AA", "turn", 7)
        assert bench.turned == {"AA": 7}
        assert "no control 'x'" in str(refusal(lambda: rig.service.operate(student, "AA", "x", 1)))

    show(tmp_path, scene, bench=bench)


def test_the_class_view_is_read_every_other_second_at_most(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        first = rig.service.robots()
        rig.stage.pull("AA")
        await asyncio.sleep(CLASS_S / 2)
        assert rig.service.robots() is first
        await asyncio.sleep(CLASS_S)
        assert rig.service.robots() is not first

    show(tmp_path, scene)


def test_people_and_tokens_are_listed_without_their_secrets(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        ada = rig.session(Role.ADMINISTRATOR)
        rig.service.add_user(ada, "<b>bob</b>", "student", PASSWORD)
        token = rig.service.new_token(ada, "<b>bob</b>", "desk")
        (line,) = [user for user in rig.service.users(ada) if user.role == "student" and user.name != "student"]
        assert (line.name, line.tokens) == ("<b>bob</b>", ["desk"])
        assert token not in line.model_dump_json()
        assert PASSWORD not in "".join(user.model_dump_json() for user in rig.service.users(ada))

    show(tmp_path, scene)


def test_a_robot_without_a_database_says_so() -> None:
    robot = Robot(
        name="R", version="", serial_number="1", released="", manufacturer="", links=[], beat_s=1, tick_s=2, life=3,
        stopped=False, window_s=0, trouble="", slots=[], arrivals=0,
    )  # fmt: skip
    records = no_records(lambda: robot)
    assert records.journal(10, None) == []
    assert [(tile.name, tile.here) for tile in records.robots()] == [("R", True)]
    for deed in (records.export, lambda: records.diff("x"), lambda: records.apply("x", "y"), records.backup,
                 lambda: records.restore(b"", "y")):  # fmt: skip
        assert "database" in str(refusal(deed))

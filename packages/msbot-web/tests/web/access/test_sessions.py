"""Sessions: bounded for each person, told of when they end, and kept over a restart; in virtual time."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from msbot.operations.rights import Role
from msbot_web.access.accounts import Accounts
from msbot_web.access.session_file import MOST_FILES, SessionFile, remove_old
from msbot_web.access.sessions import IDLE_S, LONGEST_S, MOST_SESSIONS, Session, SessionEndReason, Sessions
from msbot_web.access.users import MemoryUsers
from tests.web.access.test_accounts import Clock, PlainHasher, user


def test_a_viewers_thousand_sign_ins_end_the_viewers_sessions_only() -> None:
    clock = Clock()
    sessions = Sessions(clock)
    teacher = sessions.begin("teacher", Role.TEACHER)
    viewers = []
    for _ in range(MOST_SESSIONS + 5):
        clock.now += 1
        viewers.append(sessions.begin("viewer", Role.VIEWER))
    assert sessions.is_fresh(teacher)
    assert [sessions.is_fresh(one) for one in viewers].count(True) == MOST_SESSIONS - 1
    assert not sessions.is_fresh(viewers[0])


def test_who_listens_hears_of_ends_and_of_other_roles() -> None:
    sessions, heard = Sessions(Clock()), list[Session]()
    sessions.on_end(heard.append)
    first, second = sessions.begin("bob", Role.STUDENT), sessions.begin("bob", Role.STUDENT)
    sessions.change_role("bob", Role.STUDENT)
    assert heard == []
    sessions.change_role("bob", Role.TEACHER)
    assert heard == [first, second]
    sessions.end(first)
    assert heard == [first, second, first]
    sessions.end_all_of("bob", SessionEndReason.REMOVED)
    assert heard == [first, second, first, second]


def test_who_is_signed_out_is_told_why() -> None:
    clock = Clock()
    sessions = Sessions(clock)
    one, other, left = (sessions.begin(name, Role.STUDENT) for name in ("bob", "eve", "ann"))
    guest = sessions.begin("guest of bob", Role.VIEWER, guest_of="bob")
    assert sessions.why_ended(one.token) == ""
    sessions.end(left)
    sessions.end_all_of("bob", SessionEndReason.NEW_PASSWORD)
    clock.now += IDLE_S + 1
    sessions.end_old()
    assert sessions.why_ended(one.token) == "the password of bob was changed: sign in with the new one"
    assert sessions.why_ended(guest.token) == "your time as a guest is over: ask for a new code"
    assert "eve was signed out because nothing was done" in sessions.why_ended(other.token)
    assert sessions.why_ended(left.token) == ""  # by their own click
    for _ in range(MOST_SESSIONS):
        sessions.end(sessions.begin("eve", Role.STUDENT, guest_of="eve"))
    assert sessions.why_ended(one.token) == ""  # long ago


def test_who_is_removed_while_no_master_runs_is_told_so() -> None:
    before = Sessions(Clock())
    session = before.begin("bob", Role.STUDENT)
    after = Sessions(Clock())
    after.bring_back(before.to_persist(lambda _: ""), 5.0, lambda _: None, lambda _: "")
    assert after.why_ended(session.token).startswith("the account bob was removed")


def mode_of(path: Path) -> int:
    return path.stat().st_mode


def text_of(path: Path) -> str:
    return path.read_text()


def restarted(folder: Path, users: MemoryUsers, clock: Clock) -> tuple[Accounts, SessionFile]:
    accounts = Accounts(users, clock=clock, hasher=PlainHasher())
    file = SessionFile(accounts, folder / "sessions.json")
    file.bring_back()
    return accounts, file


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    tmp_path.chmod(0o700)
    return tmp_path


async def test_sessions_survive_a_restart_and_the_file_signs_nobody_in(folder: Path) -> None:
    users, clock = MemoryUsers(user("ada"), user("bob")), Clock()
    before, file = restarted(folder, users, clock)
    ada, bob = await before.sign_in("ada", "correct horse", "a"), await before.sign_in("bob", "correct horse", "a")
    device = before.browsers.note_sign_in("", "ada")
    gone = before.browsers.note_sign_in("", "bob")
    await file.save()
    assert mode_of(folder / "sessions.json") & 0o077 == 0
    assert ada.token not in text_of(folder / "sessions.json")
    await users.remove_user("bob", "ada")
    clock.now = 5.0  # another boot's clock
    after, _ = restarted(folder, users, clock)
    found = after.session(ada.token)
    assert found is not None
    assert (found.name, found.role, found.csrf) == ("ada", Role.ADMINISTRATOR, ada.csrf)
    assert after.session(bob.token) is None
    assert after.browsers.find(device, "ada")
    assert not after.browsers.find(gone, "bob")
    assert device not in text_of(folder / "sessions.json")
    clock.now += IDLE_S + 1
    assert after.session(ada.token) is None


@pytest.mark.parametrize("content", ["", "{", "[]", '{"at": 1}', '{"at": "x", "sessions": [], "ticket_key": ""}'])
def test_a_file_that_makes_no_sense_is_none(content: str, tmp_path: Path) -> None:
    tmp_path.chmod(0o700)
    (tmp_path / "sessions.json").write_text(content)
    accounts, _ = restarted(tmp_path, MemoryUsers(user("ada")), Clock())
    assert accounts.sessions.to_persist(accounts.mark_of) == []


def test_a_folder_of_somebody_else_is_not_believed(tmp_path: Path) -> None:
    tmp_path.chmod(0o777)
    (tmp_path / "sessions.json").write_text('{"at": 0, "sessions": [], "ticket_key": ""}')
    accounts, _ = restarted(tmp_path, MemoryUsers(user("ada")), Clock())
    assert accounts.sessions.to_persist(accounts.mark_of) == []


def test_files_that_sign_nobody_in_any_more_are_removed_and_others_are_not(folder: Path) -> None:
    now_s = 2_000_000_000.0
    ages = {"sessions-01.json": LONGEST_S, "sessions-02.json": LONGEST_S - 60, "sessions-03.new": LONGEST_S + 1}
    for name, age_s in {**ages, "page-04.json": 10 * LONGEST_S}.items():
        (folder / name).write_text("{}")
        os.utime(folder / name, (now_s - age_s, now_s - age_s))
    assert remove_old(folder, now_s) == 2
    assert sorted(path.name for path in folder.iterdir()) == ["page-04.json", "sessions-02.json"]


def test_of_too_many_files_the_oldest_are_removed(folder: Path) -> None:
    for number in range(MOST_FILES + 3):
        path = folder / f"sessions-{number:03}.json"
        path.write_text("{}")
        os.utime(path, (1000.0 + number, 1000.0 + number))
    assert remove_old(folder, 2000.0) == 3
    assert min(path.name for path in folder.iterdir()) == "sessions-003.json"
    folder.chmod(0o777)
    assert remove_old(folder, 1e12) == 0, "what is not the user's alone is left alone"
    assert remove_old(folder / "none", 1e12) == 0

"""Guests: tickets that let a device join without an account, and what guests may and may not do; in virtual time."""

from __future__ import annotations

from pathlib import Path

import httpx
import pytest

from msbot.operations.rights import Right, Role
from msbot.registry import ProgramSource
from msbot_web.access.accounts import Accounts, NotAllowed
from msbot_web.access.guest_tickets import MOST_GUESTS, MOST_OF_ONE, TICKET_S
from msbot_web.access.sessions import GUEST_S, Session
from msbot_web.access.sign_in_throttle import SignInRefused
from msbot_web.access.users import MemoryUsers
from msbot_xrce.errors import ConfigError
from tests.web.access.test_accounts import Clock, PlainHasher, user
from tests.web.access.test_sign_in_pages import COOKIE, browser, is_open
from tests.web.rig import Rig, show

__all__ = ["browser", "is_open"]


class Lesson:
    """A teacher and a student who invite."""

    def __init__(self) -> None:
        self.clock = Clock()
        self.users = MemoryUsers(
            user("ada"), user("tom", Role.TEACHER), user("sue", Role.STUDENT), user("guest of tom")
        )
        self.accounts = Accounts(self.users, clock=self.clock, hasher=PlainHasher())
        self.teacher = self.accounts.sessions.begin("tom", Role.TEACHER)
        self.student = self.accounts.sessions.begin("sue", Role.STUDENT)

    def word(self, maker: Session, guests: int = 1) -> str:
        return self.accounts.guests.invite(maker, "/program?name=phone.py", guests)[0]


@pytest.fixture
def lesson() -> Lesson:
    return Lesson()


@pytest.fixture
def accounts(lesson: Lesson) -> Accounts:
    """For the forms of `browser`."""
    return lesson.accounts


def test_a_ticket_lets_in_once_and_opens_one_page(lesson: Lesson) -> None:
    word = lesson.word(lesson.student)
    guest, path = lesson.accounts.guests.admit(word)
    assert (path, guest.name, guest.role) == ("/program?name=phone.py", "guest of sue", Role.VIEWER)
    assert [right for right in Right if guest.may(right)] == [Right.SEE, Right.STOP, Right.JOIN]
    assert lesson.accounts.session(guest.token) is guest
    for wrong in (word, "guess", ""):
        with pytest.raises(SignInRefused, match="used up or too old"):
            lesson.accounts.guests.admit(wrong)


def test_a_ticket_of_a_class_lets_a_class_in(lesson: Lesson) -> None:
    word = lesson.word(lesson.teacher, MOST_GUESTS)
    guests = {lesson.accounts.guests.admit(word)[0].key for _ in range(MOST_GUESTS)}
    assert len(guests) == MOST_GUESTS
    with pytest.raises(SignInRefused):
        lesson.accounts.guests.admit(word)
    for number in (0, MOST_GUESTS + 1):
        with pytest.raises(ConfigError, match=f"1 to {MOST_GUESTS} devices, not {number}"):
            lesson.word(lesson.teacher, number)


def test_tickets_get_old_and_a_person_has_so_many(lesson: Lesson) -> None:
    early = lesson.word(lesson.student)
    lesson.clock.now += TICKET_S - 1
    lesson.accounts.guests.tickets.find(early)
    late = [lesson.word(lesson.student) for _ in range(MOST_OF_ONE)]
    with pytest.raises(SignInRefused):  # the first made room
        lesson.accounts.guests.tickets.find(early)
    lesson.clock.now += TICKET_S
    for word in late:
        with pytest.raises(SignInRefused):
            lesson.accounts.guests.admit(word)


def test_who_may_invite(lesson: Lesson) -> None:
    guest, _ = lesson.accounts.guests.admit(lesson.word(lesson.student))
    viewer = lesson.accounts.sessions.begin("ada", Role.VIEWER)
    for nobody in (guest, viewer):
        with pytest.raises(NotAllowed):
            lesson.word(nobody)
    with pytest.raises(NotAllowed, match="a student may not"):
        lesson.word(lesson.student, 2)


async def test_guests_go_with_the_right_of_who_invited_them(lesson: Lesson) -> None:
    accounts = lesson.accounts
    word = lesson.word(lesson.student, 1)
    guest, _ = accounts.guests.admit(lesson.word(lesson.student))
    await accounts.change_role("sue", "viewer", who="ada")
    assert not accounts.holds(guest)
    with pytest.raises(SignInRefused, match="sue may not invite guests any more"):
        accounts.guests.admit(word)
    ended: list[Session] = []
    guest, _ = accounts.guests.admit(lesson.word(lesson.teacher))
    accounts.sessions.on_end(ended.append)
    open_word = lesson.word(lesson.teacher)
    await accounts.change_password("tom", "another horse", who="ada")
    assert guest in ended
    with pytest.raises(SignInRefused):
        accounts.guests.admit(open_word)


async def test_a_guest_is_no_user_of_that_name(lesson: Lesson) -> None:
    """An administrator has called somebody as a guest is called."""
    accounts = lesson.accounts
    guest, _ = accounts.guests.admit(lesson.word(lesson.teacher))
    namesake = accounts.sessions.begin("guest of tom", Role.ADMINISTRATOR)
    await accounts.change_role("guest of tom", "teacher", who="ada")
    assert (guest.role, namesake.role) == (Role.VIEWER, Role.TEACHER)
    assert accounts.sessions.of("guest of tom") == [namesake]


def test_a_guest_gets_neither_token_nor_password_nor_a_shelf(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        guest = rig.accounts.sessions.begin("student", Role.VIEWER, guest_of="teacher")  # as if a user had its name
        service = rig.service
        with pytest.raises(NotAllowed):
            await service.new_token(guest, "student", "mine")
        with pytest.raises(NotAllowed):
            await service.remove_token(guest, "student", "mine")
        with pytest.raises(NotAllowed):
            await service.change_password(guest, "student", "another horse", "correct horse")
        for deed in (
            service.programs.mine(guest),
            service.programs.store(guest, "x.py", ProgramSource("")),
            service.programs.share(guest, "x.py"),
            service.programs.invite(guest, "phone.py", 1),
        ):
            with pytest.raises(NotAllowed):
                await deed
        with pytest.raises(NotAllowed):
            service.plug(guest, "AA", plugged=False)
        assert "PHONE" in (await service.programs.source(guest, "phone.py")).text

    show(tmp_path, scene)


def test_a_guest_of_a_lesson_outlives_the_master_but_not_the_lesson(lesson: Lesson, tmp_path: Path) -> None:
    guest, _ = lesson.accounts.guests.admit(lesson.word(lesson.teacher))
    accounts = Accounts(lesson.users, clock=lesson.clock, hasher=PlainHasher())
    accounts.sessions.bring_back(
        lesson.accounts.sessions.to_persist(accounts.mark_of), 5.0, accounts.role_of, accounts.mark_of
    )
    back = accounts.session(guest.token)
    assert back is not None
    assert (back.guest_of, back.role, back.may(Right.JOIN)) == ("tom", Role.VIEWER, True)
    for _ in range(9):
        lesson.clock.now += GUEST_S / 9
        accounts.sessions.touch(back)
    assert accounts.session(guest.token) is None


async def test_only_the_button_uses_a_ticket_up(lesson: Lesson, browser: httpx.AsyncClient) -> None:
    word = lesson.word(lesson.teacher)
    for _ in range(2):  # a camera shows what is behind the link
        page = await browser.get(f"/join?ticket={word}")
        assert page.status_code == 200
        assert "tom lets this device join" in page.text
    foreign = await browser.post("/join", data={"ticket": word}, headers={"origin": "http://evil.example"})
    assert foreign.status_code == 403
    done = await browser.post("/join", data={"ticket": word})
    assert (done.status_code, done.headers["location"]) == (303, "/program?name=phone.py")
    assert f"Max-Age={GUEST_S:.0f}" in done.headers["set-cookie"]
    guest = lesson.accounts.session(browser.cookies[COOKIE])
    assert guest is not None
    assert guest.guest_of == "tom"
    again = await browser.get(f"/join?ticket={word}")  # loaded again: the device is known
    assert (again.status_code, again.headers["location"]) == (303, "/program?name=phone.py")
    browser.cookies.clear()
    for late in (await browser.get(f"/join?ticket={word}"), await browser.post("/join", data={"ticket": word})):
        assert late.status_code == 403
        assert "used up or too old" in late.text

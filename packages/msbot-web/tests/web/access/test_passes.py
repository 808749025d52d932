"""Passes: who comes in by a ticket's code, until when, and who does not any more."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from msbot.operations.rights import Role
from msbot_web.access.accounts import Accounts
from msbot_web.access.sign_in_throttle import SignInRefused
from msbot_web.access.ticket_codes import CLASS_TICKET_S, LONGEST_DAYS, TicketCodes
from msbot_web.access.users import MemoryUsers
from msbot_xrce.errors import ConfigError
from tests.web.access.test_accounts import PlainHasher, user

DAY = 86_400.0


class Office:
    """Accounts with two clocks that the test turns."""

    def __init__(self) -> None:
        self.now, self.wall = 0.0, 1e9
        people = [user("novak", Role.TEACHER), user("Äda B", Role.STUDENT), user("ben", Role.STUDENT)]
        self.accounts = Accounts(MemoryUsers(*people), clock=lambda: self.now, hasher=PlainHasher())
        self.passes = TicketCodes(self.accounts, lambda: self.now, lambda: self.wall)


def test_a_pass_signs_in_as_often_as_wanted_until_its_time_is_over() -> None:
    office = Office()
    word = office.passes.make("Äda B", 7)
    for _ in range(2):
        session = office.passes.admit(word)
        assert (session.name, session.role) == ("Äda B", Role.STUDENT)
        assert office.accounts.holds(session)
    office.wall += 7 * DAY - 1
    assert office.passes.find(word) == "Äda B"
    office.wall += 1
    with pytest.raises(SignInRefused, match="not valid"):
        office.passes.find(word)


def test_nobody_comes_in_by_a_pass_that_was_changed() -> None:
    office = Office()
    word = office.passes.make("ben", 1)
    name, ends, proof = word.split(".")
    later = f"{int(ends, 16) + 60:x}"
    changed = ("B" if proof[0] == "A" else "A") + proof[1:]
    other = office.passes.make("Äda B", 1).split(".")[0]
    wrong = [
        f"{other}.{ends}.{proof}",
        f"{name}.{later}.{proof}",
        f"{name}.{ends}.{changed}",
        f"{name}.{ends}.",
        "",
        "..",
        "%%%.1.x",
        f"{name}.zz.{proof}",
        f"{name}.-1.{proof}",
        "x" * 10_000,
    ]
    for one in wrong:
        with pytest.raises(SignInRefused):
            office.passes.admit(one)
    assert office.passes.find(word) == "ben"


def test_a_new_password_a_higher_role_and_removal_end_a_pass() -> None:
    async def scene() -> None:
        changes: tuple[Callable[[Office], Awaitable[None]], ...] = (
            lambda office: office.accounts.change_password("ben", "another one 7", who="novak"),
            lambda office: office.accounts.change_role("ben", "teacher", who="novak"),
            lambda office: office.accounts.remove_user("ben", who="novak"),
        )
        for change in changes:
            office = Office()
            word = office.passes.make("ben", 1)
            await change(office)
            with pytest.raises(SignInRefused):
                office.passes.find(word)

    asyncio.run(scene())


def test_only_pupils_have_passes_and_not_for_ever() -> None:
    office = Office()
    for name, days in (("novak", 1), ("nobody", 1), ("ben", 0), ("ben", LONGEST_DAYS + 1)):
        with pytest.raises(ConfigError):
            office.passes.make(name, days)


def test_another_master_does_not_take_it() -> None:
    word = Office().passes.make("ben", 1)
    with pytest.raises(SignInRefused):
        Office().passes.find(word)


def test_a_class_ticket_has_places_for_an_hour() -> None:
    office = Office()
    tickets = office.passes.class_tickets
    word, ticket = tickets.make("novak", "/program", 2)
    tickets.admit(word)
    tickets.admit(word)
    with pytest.raises(SignInRefused):
        tickets.admit(word)
    tickets.give_back(word)
    assert (ticket.left, ticket.guests) == (1, 1)
    office.now = CLASS_TICKET_S
    with pytest.raises(SignInRefused):
        tickets.find(word)

"""A computer whose wall clock is set back, or was wrong: no session and no ticket lives longer for that."""

from __future__ import annotations

from pathlib import Path

import pytest

from msbot.operations.rights import Role
from msbot_web.access.accounts import Accounts
from msbot_web.access.session_file import SessionFile
from msbot_web.access.sessions import GUEST_S, IDLE_S, LONGEST_S
from msbot_web.access.sign_in_throttle import SignInRefused
from msbot_web.access.ticket_codes import TicketCodes
from msbot_web.access.users import MemoryUsers
from tests.web.access.test_accounts import PlainHasher, user

PROMISE = "A clock that is set back lengthens no session and no ticket"
DAY = 86_400.0
YEAR = 365 * DAY


class Computer:
    """Its clocks, and what of it stays while masters come and go."""

    def __init__(self, folder: Path) -> None:
        folder.chmod(0o700)
        self.path = folder / "sessions.json"
        self.users = MemoryUsers(user("novak", Role.TEACHER), user("ben", Role.STUDENT))
        self.wall, self.since_boot, self.boot = 1.8e9, 1000.0, "first"

    def passes(self, seconds: float) -> None:
        self.wall += seconds
        self.since_boot += seconds

    def starts_anew(self) -> None:
        self.boot, self.since_boot = f"after {self.boot}", 20.0

    def master(self) -> tuple[Accounts, SessionFile]:
        accounts = Accounts(
            self.users, clock=lambda: self.since_boot, hasher=PlainHasher(), wall_clock=lambda: self.wall
        )
        file = SessionFile(
            accounts,
            self.path,
            wall_clock=lambda: self.wall,
            boot=lambda: self.boot,
            boot_clock=lambda: self.since_boot,
        )
        file.bring_back()
        return accounts, file


@pytest.fixture
def computer(tmp_path: Path) -> Computer:
    return Computer(tmp_path)


@pytest.mark.promise(PROMISE)
@pytest.mark.parametrize("back_s", [0.0, 60.0, DAY, 10 * YEAR, -YEAR])
async def test_a_session_is_no_younger_after_a_restart_whatever_the_clock_says(
    computer: Computer, back_s: float
) -> None:
    before, file = computer.master()
    busy = before.sessions.begin("novak", Role.TEACHER)
    guest = before.sessions.begin("guest of novak", Role.VIEWER, guest_of="novak")
    await file.save()
    computer.wall -= back_s
    computer.passes(GUEST_S / 2)
    after, file = computer.master()
    assert after.session(busy.token), "the computer's own seconds say how long nobody ran"
    assert after.session(guest.token)
    await file.save()
    computer.wall -= back_s
    computer.passes(GUEST_S / 2 + 1)
    after, _ = computer.master()
    assert after.session(busy.token)
    assert not after.session(guest.token)
    computer.passes(IDLE_S)
    after, _ = computer.master()
    assert not after.session(busy.token)


@pytest.mark.promise(PROMISE)
async def test_who_signed_in_in_the_future_signs_in_again(computer: Computer) -> None:
    before, file = computer.master()
    session = before.sessions.begin("novak", Role.TEACHER)
    await file.save()
    computer.starts_anew()
    computer.wall -= 10.0
    after, _ = computer.master()
    assert not after.session(session.token)


@pytest.mark.promise(PROMISE)
async def test_a_printed_ticket_ends_when_it_should_while_a_master_runs_and_after(computer: Computer) -> None:
    accounts, file = computer.master()
    passes = TicketCodes(accounts, accounts.clock, accounts.forward_clock.now)
    word = passes.make("ben", 1)
    computer.wall -= YEAR
    computer.passes(DAY / 2)
    assert passes.find(word) == "ben"
    await file.save()
    computer.starts_anew()
    computer.wall -= YEAR
    accounts, file = computer.master()
    passes = TicketCodes(accounts, accounts.clock, accounts.forward_clock.now)
    assert passes.find(word) == "ben", "printed tickets stay good when a computer without a clock starts"
    computer.passes(DAY / 2 + 1)
    with pytest.raises(SignInRefused):
        passes.find(word)
    await file.save()
    computer.starts_anew()
    accounts, _ = computer.master()
    passes = TicketCodes(accounts, accounts.clock, accounts.forward_clock.now)
    with pytest.raises(SignInRefused):
        passes.find(word)
    fresh = passes.make("ben", 1)
    assert passes.find(fresh) == "ben", "and new ones can be made all the same"


@pytest.mark.promise(PROMISE)
async def test_the_right_time_that_comes_late_ends_what_is_over(computer: Computer) -> None:
    accounts, _ = computer.master()
    passes = TicketCodes(accounts, accounts.clock, accounts.forward_clock.now)
    word = passes.make("ben", 30)
    computer.wall += 31 * DAY
    with pytest.raises(SignInRefused):
        passes.find(word)
    assert LONGEST_S < 31 * DAY

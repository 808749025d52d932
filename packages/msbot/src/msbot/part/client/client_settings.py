"""What may be tuned on a client, and what it reports about itself."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from enum import Enum
from typing import Self

from msbot_agent.link import LinkInfo
from msbot_xrce.errors import ConfigError, RequestTimeout
from msbot_xrce.lazy import dataclass
from msbot_xrce.messages import SESSION_DEFAULT, SESSION_NONE


class ConnectionState(Enum):
    """The state between a client and its agent."""

    CONNECTING = "connecting"
    CONNECTED = "connected"
    LOST = "lost"
    CLOSED = "closed"


@dataclass(frozen=True, slots=True)
class ClientSettings:
    """What may be tuned on a client.

    Raises:
        ConfigError: the session id is out of range.
    """

    session_id: int = SESSION_DEFAULT
    """The first of two session ids that take turns: 0x81 to 0xFE, or 1 to 0x7E (the key is in every message)."""
    mtu: int = 1400
    """Largest message in octets, both ways; the link may lower it."""
    login_period_s: float = 0.5
    """Time between two unanswered CREATE_CLIENT messages."""
    lost_after_s: float = 2.0
    """When the first login has had no answer for this long, the state is `lost`; the client keeps trying."""
    heartbeat_s: float = 0.1
    """How long to wait for an acknowledgement before a HEARTBEAT asks for it, until the round trip is known."""
    heartbeat_min_s: float = 0.001
    """The shortest such wait where messages get lost: there the wait follows the round trip."""
    asks_again: bool = False
    """Whether the login says that this client understands being told when to ask again, where many join at once; else
    the login is octet for octet that of a C client, and an agent without a free place does not answer it."""
    numbers_logins: bool = False
    """Whether each login carries a number of its own, so that an agent of MsBOT knows a copy that the network made and
    that comes late: else that starts the session's streams over, and what is under way may be lost."""
    echo: bool = True
    """Whether samples of its own writers come to its own readers, as in C clients."""
    reopen_s: float = 1.0
    """Time before the next try after the agent refused the session or the link broke."""
    quiet_s: float = 2.0
    """Silence of the agent after which it is pinged."""
    ping_s: float = 0.2
    """Time for the answer to a ping."""
    pings: int = 3
    """Pings without an answer after which the agent is lost."""
    answer_s: float = 2.0
    """A creation without a status for this long is requested again."""
    stall_s: float = 5.0
    """Creations without a status, or a full window, for this long without any progress: the session is restarted."""
    close_s: float = 1.0
    """How long a clean end waits for the agent's answer."""

    @classmethod
    def for_link(cls, info: LinkInfo) -> Self:
        """The defaults, with more patience where many share a slow medium.

        Others may go first there, hardly anything is lost, and the link itself reports when the master comes and goes;
        many impatient clients would fill the bus with questions.
        """
        if not info.shared_bus:
            return cls()
        return cls(
            login_period_s=1.0,
            lost_after_s=5.0,
            heartbeat_s=1.0,
            heartbeat_min_s=1.0,
            quiet_s=5.0,
            ping_s=2.0,
            answer_s=10.0,
            stall_s=30.0,
        )

    def __post_init__(self) -> None:
        if not (0 < self.session_id < SESSION_NONE - 1 or SESSION_NONE < self.session_id < 0xFF):
            raise ConfigError(f"session id 0x{self.session_id:02X}: choose 0x01 to 0x7E or 0x81 to 0xFE")


@dataclass(slots=True)
class ClientCounters:
    """Counts of what happened to a client since it was made."""

    logins: int = 0
    """Sessions that were opened."""
    samples_in: int = 0
    samples_out: int = 0
    dropped: int = 0
    """Packets and samples that could not be used."""


@dataclass(frozen=True, slots=True)
class PingAnswer:
    """What an agent answered to a ping."""

    round_trip_s: float
    agent_knows_us: bool
    """False when the agent has no session for this client (any more)."""


# The plumbing of a client: one flush per loop turn, one timer, one way to wait.


class WorkScheduler:
    """Calls `work(now)` once per loop turn in which `schedule` was called, and when the timer is due."""

    def __init__(self, work: Callable[[float], None]) -> None:
        self._work = work
        self._loop: asyncio.AbstractEventLoop | None = None
        self._booked = False
        self._timer: asyncio.TimerHandle | None = None
        self._armed_for = 0.0
        """The time that the timer was set to; the loop may round it."""
        self._due_at: float | None = None

    @property
    def is_running(self) -> bool:
        """Whether it was started and not cancelled."""
        return self._loop is not None

    def start(self, loop: asyncio.AbstractEventLoop) -> None:
        """Work from now on, in that loop."""
        self._loop = loop
        self.schedule()

    def cancel(self) -> None:
        """Stop working."""
        self._loop = None
        self._cancel_timer()

    def schedule(self) -> None:
        """Have the work done in the next turn; does nothing before `start`."""
        if self._loop is not None and not self._booked:
            self._booked = True
            self._loop.call_soon(self._do)

    def now(self) -> float:
        """The loop's time; 0 before `start`."""
        return self._loop.time() if self._loop is not None else 0.0

    def set_timer(self, *times: float | None) -> None:
        """Have the work done at the earliest of these times, None = never; replaces the previous timer."""
        due_at: float | None = None
        for time in times:  # a third of what `min` costs
            if time is not None and (due_at is None or time < due_at):
                due_at = time
        self._due_at = due_at
        if due_at is None:
            self._cancel_timer()
        elif self._timer is None or self._armed_for > due_at:
            self._cancel_timer()
            self._arm(due_at)
        # Else the timer comes too early and is set again then: most are put off with each packet that comes.

    def _arm(self, due_at: float) -> None:
        if self._loop is not None:
            self._armed_for = due_at
            self._timer = self._loop.call_at(due_at, self._timer_due, due_at)

    def _timer_due(self, at: float) -> None:
        self._timer = None
        if self._due_at is None:
            return
        if self._due_at > at:
            self._arm(self._due_at)
        else:
            self._do()

    def _do(self) -> None:
        self._booked = False
        if self._loop is not None:
            self._work(self._loop.time())

    def _cancel_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


class ChangeNotifier:
    """Lets coroutines wait for a condition that changes only in the loop's thread."""

    def __init__(self) -> None:
        self._event = asyncio.Event()
        self._waiters = 0

    def tell(self) -> None:
        """Something has changed: have every waiter look again."""
        if self._waiters:
            self._event.set()
            self._event = asyncio.Event()

    async def until(self, condition: Callable[[], bool], timeout_s: float | None, words: str) -> None:
        """Wait until the condition holds.

        Raises:
            RequestTimeout: it did not hold within `timeout_s` seconds; the message begins with `words`.
        """
        self._waiters += 1
        try:
            async with asyncio.timeout(timeout_s):
                while not condition():
                    await self._event.wait()
        except TimeoutError:
            raise RequestTimeout(f"{words} within {timeout_s} s") from None
        finally:
            self._waiters -= 1

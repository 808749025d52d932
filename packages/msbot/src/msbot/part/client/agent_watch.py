"""Is the agent still there? Pure: the client says what it heard, the watch says when to ping and when to give up.

An agent that was restarted, or that sees us under a new address, says nothing at all to our messages (DDS-XRCE has
no "unknown session" error; seen on the wire). Only a GET_INFO reveals it.
"""

from __future__ import annotations

from enum import Enum


class WatchStep(Enum):
    """What the client has to do now."""

    PING = "send a GET_INFO"
    GIVE_UP = "the agent is gone"


class Watch:
    """Watches one session; off until `start`."""

    def __init__(self, *, quiet_s: float, ping_s: float, pings: int) -> None:
        """Make a watch.

        Args:
            quiet_s: silence of the agent after which it is pinged.
            ping_s: time for the answer to a ping.
            pings: pings without an answer after which the agent is gone, at least 1.
        """
        self._quiet_s = quiet_s
        self._ping_s = ping_s
        self._pings = pings
        self._sent = 0
        self._due_at: float | None = None

    def start(self, now: float) -> None:
        """A session was opened."""
        self._sent = 0
        self._due_at = now + self._quiet_s

    def cancel(self) -> None:
        """There is no session to watch."""
        self._due_at = None

    def heard(self, now: float) -> None:
        """The agent sent something in this session; does nothing while off."""
        if self._due_at is not None:
            self.start(now)

    def check(self, now: float) -> None:
        """Somebody suspects that the agent is gone: ping at once, unless a ping is already under way."""
        if self._due_at is not None and self._sent == 0:
            self._due_at = now

    def timer(self) -> float | None:
        """When to call `step` next, or None while off."""
        return self._due_at

    def step(self, now: float) -> WatchStep | None:
        """What is due now, or None."""
        if self._due_at is None or now < self._due_at:
            return None
        if self._sent == self._pings:
            self.cancel()
            return WatchStep.GIVE_UP
        self._sent += 1
        self._due_at = now + self._ping_s
        return WatchStep.PING


class Stall:
    """Notices that the agent is there but takes nothing: the streams of the two ends are out of step.

    That happens when a late packet of an earlier session arrives in the new one. No acknowledgement can repair it, only
    a new session can.
    """

    def __init__(self, stall_s: float) -> None:
        """Make it; `stall_s` seconds of waiting without any progress are a stall."""
        self._stall_s = stall_s
        self._since: float | None = None

    def progress(self) -> None:
        """A request was answered, or there is room again, or there is nothing to wait for."""
        self._since = None

    def waits(self, now: float) -> float:
        """Something waits for the agent; returns when this becomes a stall: a time in the past = it is one already."""
        if self._since is None:
            self._since = now
        return self._since + self._stall_s

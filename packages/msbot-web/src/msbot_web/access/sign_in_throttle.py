"""Wrong passwords: who has to wait, and how long. Pure: time is passed in.

Three rules, so that guessing is slow and nobody is locked out by somebody else:

* A person at an address has a few free tries; then come pauses that double. So it is in each browser that the person
  is known in (`known_browsers`), whose tries count there and nowhere else.
* A person from all unknown browsers together has some more free tries; then come pauses, too. Known browsers are not
  affected.
* Attempts from unknown browsers are spaced: so many a second for an address, so many for all. They wait their turn,
  because a class behind one router has one address.

A try counts as a wrong one from its beginning: of many that are sent at once no more are looked at than of such that
are sent one after the other.
"""

from __future__ import annotations

from msbot_agent.text.sentence import said
from msbot_xrce.errors import MsbotError
from msbot_xrce.lazy import dataclass

FREE_TRIES = 5
"""Wrong passwords in a row before a pause."""
FREE_TRIES_OF_ALL = 25
"""The same for one name from all unknown browsers together."""
FIRST_PAUSE_S = 30.0
"""The pause after that; it doubles with every further wrong password."""
LONGEST_PAUSE_S = 900.0
MOST_WATCHED = 10_000
"""Names with addresses that are remembered."""
ADDRESS_STEP_S, ADDRESS_BURST = 0.5, 40
"""Attempts from one address: 40 at once (a class signs in), then one in half a second."""
TOTAL_STEP_S, TOTAL_BURST = 0.2, 80
"""The same for all addresses together."""
LONGEST_WAIT_S = 10.0
"""Longest wait of an attempt for its turn; further ones are turned away at once."""
_EVERYWHERE = "everywhere"


class SignInRefused(MsbotError):
    """Wrong name or password, or too many of them; `retry_after_s` says when it is worth another try."""

    def __init__(self, words: str, retry_after_s: float = 0.0) -> None:
        super().__init__(words)
        self.retry_after_s = retry_after_s


@dataclass(slots=True)
class _Tries:
    wrong: int = 0
    open_again_at: float = 0.0


@dataclass(slots=True)
class Spacing:
    """A leaky bucket: when it would be empty (generic cell rate algorithm)."""

    step_s: float
    burst: int
    empty_at: float = 0.0

    def wait_s(self, now: float) -> float:
        """How long the next one has to wait."""
        return max(0.0, self.empty_at - now - self.step_s * (self.burst - 1))

    def admit(self, now: float) -> None:
        """Let one through, now or after its wait."""
        self.empty_at = max(self.empty_at, now) + self.step_s


class SignInThrottle:
    """See the module's docstring."""

    def __init__(self) -> None:
        self._tries: dict[tuple[str, str], _Tries] = {}
        self._spacings: dict[str, Spacing] = {}
        self._total = Spacing(TOTAL_STEP_S, TOTAL_BURST)

    def admit(self, name: str, address: str, device: str, now: float) -> float:
        """Let an attempt begin, which counts as wrong until `right` or `left` is said.

        Args:
            name: who it claims to be.
            address: where it comes from.
            device: names the browser if this person is known in it, else empty.
            now: seconds.

        Returns:
            Seconds to wait before the password is checked.

        Raises:
            SignInRefused: too many wrong ones; it says how long to wait.
        """
        pause_s = max(
            (self._tries[key].open_again_at - now for key in self._keys(name, address, device) if key in self._tries),
            default=0.0,
        )
        if pause_s > 0:
            raise SignInRefused(
                said("too many wrong passwords: try again in {pause_s:.0f} s", pause_s=pause_s), pause_s
            )
        if device:
            self._count(name, address, device, now)
            return 0.0
        spacing = self._spacing(address, now)
        wait_s = max(spacing.wait_s(now), self._total.wait_s(now))
        if wait_s > LONGEST_WAIT_S:
            raise SignInRefused(
                said("too many people are signing in at this moment: try again in 10 s"), LONGEST_WAIT_S
            )
        spacing.admit(now)
        self._total.admit(now)
        self._count(name, address, device, now)
        return wait_s

    def right(self, name: str, address: str, device: str) -> None:
        """The password was right."""
        for key in self._keys(name, address, device):
            self._tries.pop(key, None)

    def abandoned(self, name: str, address: str, device: str) -> None:
        """Nobody was told whether the password was right: the attempt does not count."""
        for key in self._keys(name, address, device):
            if (tries := self._tries.get(key)) is not None:
                tries.wrong -= 1
                if tries.wrong < _free_tries(key):
                    tries.open_again_at = 0.0
                if tries.wrong <= 0:
                    del self._tries[key]

    def _count(self, name: str, address: str, device: str, now: float) -> None:
        """One more that may be wrong."""
        for key in self._keys(name, address, device):
            if key not in self._tries and len(self._tries) >= MOST_WATCHED:
                del self._tries[next(iter(self._tries))]
            tries = self._tries.setdefault(key, _Tries())
            tries.wrong += 1
            if tries.wrong >= (free := _free_tries(key)):
                pause_s = min(FIRST_PAUSE_S * 2.0 ** min(tries.wrong - free, 16), LONGEST_PAUSE_S)
                tries.open_again_at = now + pause_s

    def _keys(self, name: str, address: str, device: str) -> tuple[tuple[str, str], ...]:
        who = name[:64].casefold()
        return ((who, f"device {device}"),) if device else ((who, address), (who, _EVERYWHERE))

    def _spacing(self, address: str, now: float) -> Spacing:
        if address not in self._spacings and len(self._spacings) >= MOST_WATCHED:
            self._spacings = {key: one for key, one in self._spacings.items() if one.empty_at > now}
            if len(self._spacings) >= MOST_WATCHED:
                del self._spacings[next(iter(self._spacings))]
        return self._spacings.setdefault(address, Spacing(ADDRESS_STEP_S, ADDRESS_BURST))


def _free_tries(key: tuple[str, str]) -> int:
    return FREE_TRIES_OF_ALL if key[1] == _EVERYWHERE else FREE_TRIES

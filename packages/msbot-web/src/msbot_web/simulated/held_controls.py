"""Controls of simulated parts that people hold: a pressed button, a motor's power. Pure.

Only what goes back when it is released counts (`momentary`); a knob stays where somebody has turned it. Whoever holds
one and is gone lets it go: the page is closed or its connection lost, the session is over, the API token is taken back.
A pupil lets it go as well when the class is frozen, at a take-over, and at a change of group.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

from msbot_web.models.robot_models import Scalar
from msbot_web.simulated.controls import SimulatedControls
from msbot_xrce.lazy import dataclass


@dataclass(frozen=True, slots=True)
class _Hold:
    """One control that is held."""

    who: str
    """The pupil; empty: a teacher."""
    by: frozenset[object]
    """With what: the page, the session, the API token. When one of them is gone, nobody holds it."""


class HeldControls:
    """See the module's docstring.

    Args:
        bench: gives the simulated parts.
    """

    def __init__(self, bench: Callable[[], SimulatedControls]) -> None:
        self._bench = bench
        self._held: dict[tuple[str, str], _Hold] = {}
        """By `(slot, control)`."""

    def operated(self, who: str, by: Collection[object], slot: str, control: str, value: Scalar) -> bool:
        """Somebody has set a control, a pupil or (an empty name) a teacher; says whether a pupil holds it now."""
        rest = self._bench().rest_value(slot, control)
        if rest is None or value == rest:
            self._held.pop((slot, control), None)
            return False
        self._held[slot, control] = _Hold(who, frozenset(by))
        return bool(who)

    def end_where(self, is_over: Callable[[str, str], bool]) -> None:
        """Let go of those of which `(slot, pupil who holds it)` is true."""
        self._end(lambda slot, hold: bool(hold.who) and is_over(slot, hold.who))

    def end_at(self, slot: str) -> None:
        """Let go of everything at a part, whoever holds it."""
        self._end(lambda held, _hold: held == slot)

    def end_by(self, gone: object) -> None:
        """Let go of what was held with that page, session or API token."""
        self._end(lambda _slot, hold: gone in hold.by)

    def _end(self, is_over: Callable[[str, _Hold], bool]) -> None:
        for (slot, control), hold in list(self._held.items()):
            if not is_over(slot, hold):
                continue
            del self._held[slot, control]
            rest = self._bench().rest_value(slot, control)
            if rest is None:  # it was pulled out: what is plugged in next is not pressed
                continue
            self._bench().operate(slot, control, rest)

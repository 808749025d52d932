"""Controls of simulated parts that pupils hold: a pressed button, a motor's power. Pure.

Only what goes back when it is released counts (`momentary`); a knob stays where somebody has turned it. Whoever may no
longer hold one lets it go: when the class is frozen, at a take-over, a change of group, a sign-out.
"""

from __future__ import annotations

from collections.abc import Callable

from msbot_web.api.models import Scalar
from msbot_web.simulated.bench import Bench


class HeldControls:
    """See the module's docstring.

    Args:
        bench: gives the simulated parts.
    """

    def __init__(self, bench: Callable[[], Bench]) -> None:
        self._bench = bench
        self._held: dict[tuple[str, str], str] = {}
        """`(slot, control)` -> who holds it."""

    def operated(self, who: str, slot: str, control: str, value: Scalar) -> bool:
        """Somebody has set a control, a pupil or (an empty name) a teacher; says whether a pupil holds it now."""
        rest = self._bench().rest(slot, control)
        if not who or rest is None or value == rest:
            self._held.pop((slot, control), None)
            return False
        self._held[slot, control] = who
        return True

    def end_where(self, is_over: Callable[[str, str], bool]) -> None:
        """Let go of those of which `(slot, who holds it)` is true."""
        for (slot, control), who in list(self._held.items()):
            if not is_over(slot, who):
                continue
            del self._held[slot, control]
            rest = self._bench().rest(slot, control)
            if rest is None:  # it was pulled out: what is plugged in next is not pressed
                continue
            self._bench().operate(slot, control, rest)

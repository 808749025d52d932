"""How many connections a second a server takes, before it has read a word of any. Pure: time is handed in.

A connection costs a server most at its beginning: negotiations, headers, a first page. Strangers are bounded by their
address and in all, so that a flood costs a bounded part of the time. Addresses that are known (a part with a place, a
browser that is signed in) have a share of their own, which no stranger can use up.
"""

from __future__ import annotations

from collections.abc import Callable

from msbot_agent.pace.steady_rate import SteadyRate

BURST_S = 5.0
"""After a pause, as many connections as come in this time may come at once."""
KNOWN_TIMES = 4.0
"""A known address may make so many times as many connections as an unknown one."""
MOST_ADDRESSES = 4096

_EVERYBODY = "everybody"


class ConnectionPace:
    """See the module's docstring.

    Args:
        of_address: connections a second from one unknown address.
        in_all: from all unknown addresses together.
        knows: whether an address is known.
        is_shared: whether an address passes on what others ask, as a trusted proxy does: it has no bound, because one
            stranger would use up everybody's; the proxy can bound strangers itself.
    """

    def __init__(
        self, of_address: float, in_all: float, knows: Callable[[str], bool],
        is_shared: Callable[[str], bool] = lambda _: False,
    ) -> None:  # fmt: skip
        self._is_shared = is_shared
        self._of_address = SteadyRate(of_address, of_address * BURST_S, MOST_ADDRESSES)
        self._in_all = SteadyRate(in_all, in_all * BURST_S, 1)
        known = KNOWN_TIMES * of_address
        self._known = SteadyRate(known, known * BURST_S, MOST_ADDRESSES)
        self._knows = knows

    def takes(self, address: str, now: float) -> bool:
        """Whether a connection that has come from there is taken; if not, it is to be closed at once."""
        if self._is_shared(address):
            return True
        bounds = (
            [(self._known, address)]
            if self._knows(address)
            else [(self._of_address, address), (self._in_all, _EVERYBODY)]
        )
        if any(rate.wait_s(caller, now) > 0.0 for rate, caller in bounds):
            return False
        for rate, caller in bounds:
            rate.note(caller, now)
        return True

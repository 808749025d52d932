"""A link that loses, duplicates, reorders and delays packets, the same way every time for the same random seed."""

from __future__ import annotations

from random import Random

from msbot_agent.link.contract import Link
from msbot_agent.link.disturbed import Disturbance, DisturbedLink


class LossyLink(DisturbedLink):
    """Wraps any link and disturbs its packets in both directions; satisfies `Link`.

    Args:
        link: the link that carries the remaining packets.
        random, drop, duplicate, reorder, delay: see `Disturbance`.
    """

    def __init__(
        self, link: Link, *, random: Random, drop: float = 0.0, duplicate: float = 0.0, reorder: float = 0.0,
        delay: float = 0.0,
    ) -> None:  # fmt: skip
        self.disturbance = Disturbance(random, drop=drop, duplicate=duplicate, reorder=reorder, delay=delay)
        """What happens to the packets; may be changed while the link runs."""
        super().__init__(link, self.disturbance)

"""The person behind a peer: known where the page's server has asked who is there, and nowhere else.

Whatever is spoken inside such a connection stays that person's: a part behind a relay that came in by it, and a part at
an agent that came in by it, too.
"""

from __future__ import annotations

from msbot_agent.link.contract import Peer
from msbot_xrce.common.lazy_dataclass import dataclass


@dataclass(frozen=True, slots=True)
class Visitor:
    """The person behind a connection."""

    person: str
    address: str
    """The computer's address, without the port."""
    pupil: str = ""
    """The pupil whose rights everything from there has, whom a teacher may hold; empty: it is no pupil's."""


def visitor_behind(peer: Peer) -> Visitor | None:
    """The person behind a peer; None: nobody has asked."""
    visitor = getattr(peer, "visitor", None)
    return visitor if isinstance(visitor, Visitor) else None


def pupil_behind(peer: Peer) -> str:
    """The pupil behind a peer; empty: it is somewhere else, or somebody else's."""
    visitor = visitor_behind(peer)
    return "" if visitor is None else visitor.pupil

"""What people see of a client."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from typing import TYPE_CHECKING

from msbot_agent.agent.gate import ClientInfo
from msbot_agent.agent.object_tree import ObjectTree
from msbot_agent.agent.statistics import ClientView, ObjectView, StreamView
from msbot_xrce import GIVEN_UP
from msbot_xrce.counting import Tally
from msbot_xrce.messages import ObjectKind, kind_of

if TYPE_CHECKING:
    from msbot_agent.agent.proxy import Proxy


def view_of(proxy: Proxy, tree: ObjectTree, opened_at: float, now: float) -> ClientView:
    """A view of a client with these objects, whose session was opened then."""
    dropped = Tally(proxy.dropped, limit=256)
    dropped.count_all(proxy.session.dropped)
    entities = list(tree.items())
    sides = [entity.endpoint for _, entity in entities if entity.endpoint is not None]
    return ClientView(
        key=proxy.info.key,
        session_id=proxy.session.session_id,
        link=proxy.info.link,
        address=proxy.info.address,
        mtu=proxy.session.mtu,
        age_s=now - opened_at,
        silent_s=now - proxy.last_heard,
        objects=tuple(
            ObjectView(number, ObjectKind(kind_of(number)).name.lower(), one.topic_name, one.is_attached, one.troubles)
            for number, one in entities
        ),
        packets_in=proxy.session.counters.packets_in,
        packets_out=proxy.session.counters.packets_out,
        bytes_in=proxy.bytes_in,
        bytes_out=proxy.bytes_out,
        published=sum(endpoint.outgoing.published for endpoint in sides if endpoint.outgoing is not None),
        delivered=sum(endpoint.incoming.delivered for endpoint in sides if endpoint.incoming is not None),
        waiting=len(proxy.outbox),
        streams=tuple(
            StreamView(state.stream_id, state.outgoing, state.last, state.unacked, state.waiting)
            for state in proxy.session.stream_states()
        ),
        resent=proxy.session.counters.resent,
        repeated=proxy.session.counters.repeated,
        gone=proxy.gone,
        dropped=dropped,
        refused=Tally(proxy.refused),
    )


# What a stock client cannot take, whatever the agent does.


logger = logging.getLogger(__name__)

LARGEST_TO_STOCK = 0xFFFF - 4
"""Octets of the largest sample for a stock client: with the ids in front, its length must fit 16 bits."""
TOO_LARGE_FOR_STOCK = "sample too large for a stock client"


def drop_too_large(info: ClientInfo, object_id: int, size: int, dropped: Tally) -> None:
    """Count a sample that is not sent, and tell of the first: it would arrive cut, and spoil what follows it."""
    if TOO_LARGE_FOR_STOCK not in dropped:
        logger.warning(
            "client %08X, object %04X: a sample of %d bytes is not sent, as none above %d is: stock clients count in"
            " 16 bits",
            info.key,
            object_id,
            size,
            LARGEST_TO_STOCK,
        )
    dropped.count(TOO_LARGE_FOR_STOCK)


def tell_of_lost(info: ClientInfo, stream_id: int, count: int, dropped: Mapping[str, int]) -> None:
    """Tell of messages that a client has lost; of the first ones aloud, since a network that reorders makes many."""
    level = logging.WARNING if dropped[GIVEN_UP] == count else logging.DEBUG
    logger.log(
        level,
        "client %08X on %s: %d message(s) of stream 0x%02X are lost: its network let acknowledgements overtake each"
        " other, and a stock client then forgets what it has sent",
        info.key,
        info.link,
        count,
        stream_id,
    )

"""What people see of a client."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_agent.agent.object_tree import ObjectTree
from msbot_agent.agent.statistics import ClientView, ObjectView, StreamView
from msbot_xrce.common.tally import Tally
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

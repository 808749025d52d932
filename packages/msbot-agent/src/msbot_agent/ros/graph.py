"""Tells ROS 2 nodes whose our writers and readers are, so that `ros2 node list` and `ros2 topic info -v` show nodes.

In ROS 2 a node is not a thing of DDS: each program publishes the list of its nodes with the GUIDs of their endpoints
(topic `ros_discovery_info`, transient-local, only the last one counts). Here a part of the robot is a node, and so is
every participant of a micro-ROS client. The list is published again when something has changed, once for all changes
within `SETTLE_S` (longer with many). A node that lacks parameter services gets them, because `ros2 param list` waits
for all of them at every node.
"""

from __future__ import annotations

import asyncio
import logging
import os
import secrets
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from functools import partial

from msbot_agent.ros import discovery_info
from msbot_agent.ros.discovery_info import NodeInfo, decode, encode, gid_octets_of, usual_gid_octets
from msbot_agent.ros.missing_parameters import MissingParameterService, missing_services
from msbot_agent.ros.node_names import NodeName, node_named
from msbot_agent.space import Guid, OwnEndpoint, Qos, Reader, Sample, SharedSpace, Topic, Writer
from msbot_xrce.errors import RemoteProtocolError

SETTLE_S = 0.02
"""A part comes with all its endpoints at once; their nodes are told together after this time."""
SETTLE_S_EACH = 20e-6
"""As much longer for each endpoint that was told last, so that many parts that come one by one do not take all time."""

EVERYBODY = ("",)
"""The partition in which ROS 2 nodes are."""

MAX_OTHERS = 512
"""Other programs whose nodes are remembered, to notice that one has a name of ours."""

LAST_ONE = Qos(transient_local=True, depth=1, late_depth=1, partitions=EVERYBODY)

NodeOf = Callable[[OwnEndpoint], NodeName | None]
"""The node that an endpoint belongs to; None: it is no node's."""

logger = logging.getLogger(__name__)


class RosGraph:
    """Publishes the nodes of this program. Must be made on the event loop that the space lives on."""

    def __init__(
        self,
        space: SharedSpace,
        *,
        node_of: NodeOf | None = None,
        standing: Callable[[], Iterable[NodeName]] = tuple,
        environment: Mapping[str, str] = os.environ,
    ) -> None:
        """Begin to publish.

        Args:
            space: whose endpoints to tell.
            node_of: the node of an endpoint; by the name of its participant if absent.
            standing: nodes that are there even without endpoints.
            environment: where `ROS_DISTRO` may say which form the nodes of the network read.
        """
        self._space = space
        self._node_of = node_of or node_of_participant
        self._standing = standing
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        self._writers: dict[int, Writer] = {}
        self._bare: dict[tuple[int, NodeName, str, str], MissingParameterService] = {}
        """By domain, node, service and why it sets nothing."""
        self._readers: list[Reader] = []
        self._told: dict[int, bytes] = {}
        self._size = 0
        distribution = environment.get("ROS_DISTRO")
        self._octets = usual_gid_octets(distribution)
        self._is_fixed = distribution is not None
        self._has_warned = self._is_closed = False
        self._others: dict[Guid, frozenset[str]] = {}
        """Participant elsewhere -> its nodes."""
        self._mine: frozenset[str] = frozenset()
        self._twins: set[str] = set()
        """Nodes that were told to be there twice."""
        space.on_endpoints(self.changed)
        self.changed()

    @property
    def gid_length(self) -> int:
        """The form in which it publishes now: 16 or 24 octets for a GID."""
        return self._octets

    def changed(self) -> None:
        """Tell the nodes again soon: something about them may have changed."""
        if self._timer is None and not self._is_closed:
            self._timer = self._loop.call_later(SETTLE_S + SETTLE_S_EACH * self._size, self._tell)

    def close(self) -> None:
        """Tell that no node is left, and stop telling: Fast DDS forgets nobody for 10 s who only leaves."""
        if self._timer is not None:
            self._timer.cancel()
        self._is_closed = True
        participants = self._space.participants()
        for domain, writer in self._writers.items():
            if domain in participants:
                writer.write(encode(participants[domain], (), self._octets))
            writer.close()
        for reader in self._readers:
            reader.close()
        for bare in self._bare.values():
            bare.close()
        self._writers.clear()
        self._readers.clear()
        self._bare.clear()

    def _tell(self) -> None:
        self._timer = None
        if not self._space.participants():
            return  # the space has left DDS
        self._see_to_parameters()
        nodes = self._nodes()
        self._mine = frozenset(str(node.name) for told in nodes.values() for node in told)
        for others in self._others.values():
            self._look_for_twins(others)
        for domain, participant in self._space.participants().items():
            mine = nodes.get(domain, [])
            if not mine and domain not in self._writers:
                continue  # nobody asked this program into ROS
            octets = encode(participant, mine, self._octets)
            if octets != self._told.get(domain):
                self._told[domain] = octets
                self._writer(domain).write(octets)

    def _see_to_parameters(self) -> None:
        """A node that lacks some of the parameter services gets them from here."""
        answering = {id(bare.owner) for bare in self._bare.values()}
        theirs = [endpoint for endpoint in self._space.endpoints() if id(endpoint.owner) not in answering]
        first = next(iter(self._space.participants()), 0)
        nodes = dict.fromkeys((first, name) for name in self._standing())
        read: defaultdict[int, set[str]] = defaultdict(set)
        """By domain."""
        for endpoint in theirs:
            if is_ros(endpoint.name):
                name = self._node_of(endpoint)
                if name is not None:
                    nodes[endpoint.domain, name] = None
                if not endpoint.is_writer:
                    read[endpoint.domain].add(endpoint.name)
        wanted = [
            (domain, node, service, reason)
            for domain, node in nodes
            for service, reason in missing_services(node, read[domain]).items()
        ]
        for key in self._bare.keys() - set(wanted):
            self._bare.pop(key).close()
        for key in wanted:
            if key not in self._bare:
                domain, node, service, reason = key
                self._bare[key] = MissingParameterService(self._space, node, domain, service, reason)

    def _nodes(self) -> dict[int, list[NodeInfo]]:
        """The nodes in each domain, in the order in which they appeared."""
        endpoints = [endpoint for endpoint in self._space.endpoints() if is_ros(endpoint.name)]
        self._size = len(endpoints)
        shared = {
            (endpoint.domain, endpoint.name): endpoint.guid
            for endpoint in endpoints
            if not endpoint.is_writer and endpoint.name.startswith("rr/")
        }
        first = next(iter(self._space.participants()), 0)
        found: dict[tuple[int, NodeName], tuple[dict[Guid, None], dict[Guid, None]]] = {
            (first, name): ({}, {}) for name in self._standing()
        }
        for endpoint in endpoints:
            name = self._node_of(endpoint)
            if name is None:
                continue
            readers, writers = found.setdefault((endpoint.domain, name), ({}, {}))
            (writers if endpoint.is_writer else readers)[endpoint.guid] = None
            if endpoint.is_writer and endpoint.name.startswith("rq/"):
                # All requesters of an agent share one reader of the replies; for ROS 2 each has its own.
                replies = shared.get((endpoint.domain, reply_topic(endpoint.name)))
                if replies is not None:
                    readers[replies] = None
        nodes: dict[int, list[NodeInfo]] = {}
        for (domain, name), (readers, writers) in found.items():
            nodes.setdefault(domain, []).append(NodeInfo(name, tuple(readers), tuple(writers)))
        return nodes

    def _writer(self, domain: int) -> Writer:
        writer = self._writers.get(domain)
        if writer is None:
            topic = Topic(discovery_info.TOPIC, discovery_info.TYPE, domain)
            writer = self._writers[domain] = self._space.writer(topic, LAST_ONE, secrets.token_bytes(16))
            self._readers.append(self._space.reader(topic, LAST_ONE, partial(self._heard, writer.guid)))
        return writer

    def _remember(self, payload: bytes) -> None:
        """Learn from others which nodes they have."""
        try:
            participant, nodes = decode(payload, self._octets)
        except RemoteProtocolError:
            return  # it is in the other form, which is told
        if participant in self._space.participants().values():
            return
        names = self._others[participant] = frozenset(str(node.name) for node in nodes)
        if len(self._others) > MAX_OTHERS:
            del self._others[next(iter(self._others))]
        self._look_for_twins(names)

    def _look_for_twins(self, others: frozenset[str]) -> None:
        twins = (others & self._mine) - self._twins
        if not twins or len(self._twins) > MAX_OTHERS:
            return
        self._twins |= twins
        shortest = min(twins, key=lambda name: (len(name), name))
        more = f" and {len(twins) - 1} more" if len(twins) > 1 else ""
        logger.warning(
            "another program in this network has a ROS 2 node %s%s, too: each hears what is meant for the other; "
            "give one of the two another name, or another domain",
            shortest,
            more,
        )

    def _heard(self, own: Guid, sample: Sample) -> bool:
        """Learn from other nodes which form the network uses, and whether a name is there twice."""
        if sample.writer == own:
            return True
        self._remember(sample.payload)
        theirs = gid_octets_of(sample.payload)
        if theirs is None or theirs == self._octets:
            return True
        if not self._is_fixed and theirs == discovery_info.UNTIL_HUMBLE:
            # 16 may be another MsBOT that has not heard anybody yet; 24 says nobody by mistake.
            self._octets = theirs
            self.changed()
        elif not self._has_warned:
            self._has_warned = True
            logger.warning(
                "a ROS 2 node tells of its nodes with GIDs of %d bytes, here they have %d: it does not see this "
                "program's nodes (ROS 2 up to Humble has 24, from Iron on 16; ROS_DISTRO says which is right here)",
                theirs,
                self._octets,
            )
        return True


def is_ros(topic: str) -> bool:
    """Whether a topic in DDS is one of ROS 2: a topic, or requests or replies of a service."""
    return topic.startswith(("rt/", "rq/", "rr/"))


def reply_topic(request_topic: str) -> str:
    """The topic of the replies to the requests on that one."""
    return f"rr/{request_topic.removeprefix('rq/').removesuffix('Request')}Reply"


def node_of_participant(endpoint: OwnEndpoint) -> NodeName | None:
    """The node of an endpoint by the name of its participant, as micro-ROS has it; None for what nobody named."""
    name = endpoint.owner.participant
    return node_named(name) if name else None

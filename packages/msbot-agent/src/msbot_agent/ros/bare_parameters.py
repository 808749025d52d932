"""The answer of a node that has no parameters to who asks every node for its parameters.

`ros2 param list` asks each node that it sees, and waits until each answers. So a node that has no such service itself,
as most boards, gets this one.
"""

from __future__ import annotations

import secrets

from msbot_agent.ros.node_names import NodeName
from msbot_agent.space import Guid, Owner, Qos, Sample, Space, Topic, Writer

SERVICE = Qos(depth=16, partitions=("",), service=True)
TYPE = "rcl_interfaces::srv::dds_::ListParameters"
NO_NAMES_AND_NO_PREFIXES = bytes(8)
"""`rcl_interfaces/srv/ListParameters` with two empty lists: none of the types of ROS 2 need be loaded for that."""


def requests_of(node: NodeName) -> str:
    """The topic on which a node is asked."""
    return f"rq{node}/list_parametersRequest"


class BareParameters:
    """The service of one node."""

    def __init__(self, space: Space, node: NodeName, domain: int) -> None:
        self.owner = owner = Owner(participant=str(node))
        """By which its endpoints are told from those of the node itself."""
        replies = Topic(f"rr{node}/list_parametersReply", f"{TYPE}_Response_", domain)
        self._writer: Writer = space.writer(replies, SERVICE, secrets.token_bytes(16), owner)
        requests = Topic(requests_of(node), f"{TYPE}_Request_", domain)
        self._reader = space.reader(requests, SERVICE, self._take, owner)

    def close(self) -> None:
        """Answer no more."""
        self._reader.close()
        self._writer.close()

    def _take(self, sample: Sample) -> bool:
        related: tuple[Guid, int] = (sample.writer, sample.sequence_nr)
        self._writer.write(NO_NAMES_AND_NO_PREFIXES, related)
        return True

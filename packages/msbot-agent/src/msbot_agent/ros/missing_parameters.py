"""The parameter services that a node does not have itself, for who asks every node for its parameters.

`ros2 param` waits until a node has all six services of `rcl_interfaces` before it asks for anything. Most boards have
none; rclc's parameter server had five up to Humble, which set one by one only. What is missing is answered here:
there are no parameters, and nothing can be set.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Container
from functools import partial
from struct import pack, unpack_from

from msbot_agent.ros.node_names import NodeName
from msbot_agent.space import Guid, Owner, Qos, Sample, Space, Topic, Writer

SERVICE = Qos(depth=16, partitions=("",), service=True)
LIST = "list_parameters"
"""The service of which a node without parameters has none."""

NO_PARAMETERS = "this node has no parameters"
ONE_BY_ONE = "this node sets its parameters one by one"

LEAST_PARAMETER = 40
"""Octets of the shortest `rcl_interfaces/msg/Parameter`: no request has more of them than fit."""


def requests_of(node: NodeName, service: str) -> str:
    """The topic on which a node is asked."""
    return f"rq{node}/{service}Request"


def missing_services(node: NodeName, read: Container[str]) -> dict[str, str]:
    """The services that a node lacks, each with the reason why it sets nothing.

    Args:
        node: whose they are.
        read: the topics that nodes read in its domain.
    """
    reason = ONE_BY_ONE if requests_of(node, LIST) in read else NO_PARAMETERS
    return {service: reason for service in _ANSWERS if requests_of(node, service) not in read}


class MissingParameterService:
    """One service of one node."""

    def __init__(self, space: Space, node: NodeName, domain: int, service: str, reason: str) -> None:
        """Answer from now on.

        Args:
            space: where the node is.
            node: its name.
            domain: its DDS domain.
            service: one of `missing_services`.
            reason: why nothing is set.
        """
        self.owner = owner = Owner(participant=str(node))
        """By which its endpoints are told from those of the node itself."""
        kind, self._answer = _ANSWERS[service]
        self._refusal = _refusal(reason)
        replies = Topic(f"rr{node}/{service}Reply", f"rcl_interfaces::srv::dds_::{kind}_Response_", domain)
        self._writer: Writer = space.writer(replies, SERVICE, secrets.token_bytes(16), owner)
        requests = Topic(requests_of(node, service), f"rcl_interfaces::srv::dds_::{kind}_Request_", domain)
        self._reader = space.reader(requests, SERVICE, self._take, owner)

    def close(self) -> None:
        """Answer no more."""
        self._reader.close()
        self._writer.close()

    def _take(self, sample: Sample) -> bool:
        related: tuple[Guid, int] = (sample.writer, sample.sequence_nr)
        self._writer.write(self._answer(sample.payload, self._refusal), related)
        return True


# Replies in CDR, written by hand: none of the types of ROS 2 need be loaded for them.

Answer = Callable[[bytes, bytes], bytes]
"""From a request and the refusal to the reply."""


def _refusal(reason: str) -> bytes:
    """`rcl_interfaces/msg/SetParametersResult`, not successful, padded to the next one."""
    text = reason.encode() + b"\0"
    return pack("<?3xI", False, len(text)) + text + bytes(-len(text) % 4)


def _nothing(lists: int, _request: bytes, _refused: bytes) -> bytes:
    """So many empty lists."""
    return bytes(4 * lists)


def _refuse_each(request: bytes, refused: bytes) -> bytes:
    """One result for each parameter of the request."""
    fit = len(request) // LEAST_PARAMETER
    count: int = min(unpack_from("<I", request)[0], fit) if fit else 0
    return pack("<I", count) + refused * count


def _refuse_all(_request: bytes, refused: bytes) -> bytes:
    return refused


_ANSWERS: dict[str, tuple[str, Answer]] = {
    LIST: ("ListParameters", partial(_nothing, 2)),
    "describe_parameters": ("DescribeParameters", partial(_nothing, 1)),
    "get_parameters": ("GetParameters", partial(_nothing, 1)),
    "get_parameter_types": ("GetParameterTypes", partial(_nothing, 1)),
    "set_parameters": ("SetParameters", _refuse_each),
    "set_parameters_atomically": ("SetParametersAtomically", _refuse_all),
}
"""The name of each service's type, and its answer."""

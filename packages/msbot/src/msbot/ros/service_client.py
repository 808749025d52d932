"""Ports that call services of genuine nodes: a part asks, and the robot asks the node on its behalf.

The wire is a binding without `from`: no part serves it, a node of ROS 2 does. While STOP holds, nothing is asked.
"""

from __future__ import annotations

import secrets
from collections import OrderedDict
from typing import Final

from msbot.master import Master
from msbot.master.ros_services import SERVICE, RosService
from msbot.part.calls import ReplyStatus, encode_reply
from msbot.ros.ros_log import ERROR, RosLog
from msbot.service_types import reply_topic, request_topic
from msbot_agent.ros.node_names import NodeName
from msbot_agent.space import Guid, Owner, Qos, Sample, Space, Topic
from msbot_xrce.errors import CallError, RemoteProtocolError

MOST_OPEN: Final = 64
"""Requests of parts to one service that wait; the oldest makes room, because the part has its own timeout."""
_INSIDE: Final = Qos(service=True)


class ServiceClient:
    """Asks one service of ROS 2 for the parts of a robot. Must be made on its event loop."""

    def __init__(self, master: Master, space: Space, service: RosService, node: NodeName, log: RosLog) -> None:
        self._master = master
        self._service = service
        self._node = node
        self._log = log
        self._open: OrderedDict[int, tuple[Guid, int]] = OrderedDict()
        self._guid = secrets.token_bytes(16)
        owner, inside, kind = Owner(participant=str(node)), master.space, service.kind
        topic = service.binding.topic
        self._ask = space.writer(service.requests, SERVICE, self._guid, owner)
        self._told = space.reader(service.replies, SERVICE, self._replied, owner)
        self._reply = inside.writer(Topic(reply_topic(topic), kind.reply), _INSIDE, secrets.token_bytes(16))
        master.inventory.served_outside.add(topic)
        self._asked = inside.reader(Topic(request_topic(topic), kind.request), _INSIDE, self._requested)

    def close(self) -> None:
        """Ask no more."""
        self._master.inventory.served_outside.discard(self._service.binding.topic)
        for end in (self._asked, self._reply, self._told, self._ask):
            end.close()

    def _requested(self, sample: Sample) -> bool:
        identity = sample.writer, sample.sequence_nr
        if self._master.stop.stopped:
            self._reply.write(encode_reply(ReplyStatus.STOPPED), identity)
            return True
        try:
            octets = self._service.form.request_outward(sample.payload)
        except RemoteProtocolError as error:
            self._reply.write(encode_reply(ReplyStatus.UNREADABLE, str(error)), identity)
            return True
        if self._ask.readers == 0:
            why = f"no node of ROS 2 serves {self._service.name} now: `ros2 service list` shows those that do"
            self._reply.write(encode_reply(ReplyStatus.NOT_PASSED, why), identity)
            return True
        self._open[self._ask.published + 1] = identity  # its number; the reply may come before `write` returns
        self._ask.write(octets)
        while len(self._open) > MOST_OPEN:
            self._open.popitem(last=False)
        return True

    def _replied(self, sample: Sample) -> bool:
        if sample.related is None or sample.related[0] != self._guid:
            return True
        identity = self._open.pop(sample.related[1], None)
        if identity is None:
            return True
        try:
            octets = encode_reply(ReplyStatus.DONE, self._service.form.reply_inward(sample.payload))
        except CallError as error:
            octets = encode_reply(ReplyStatus.REFUSED, str(error))
        except RemoteProtocolError as error:
            self._log.write(self._node, ERROR, f"reply of {self._service.name}: {error}")
            octets = encode_reply(ReplyStatus.FAILED, f"its reply cannot be read: {error}")
        self._reply.write(octets, identity)
        return True

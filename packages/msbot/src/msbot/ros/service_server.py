"""Services of parts as services of ROS 2: a node asks, and the robot calls the part on its behalf.

A request takes the same way as `msbot call`: who may, frozen classes, STOP, ranges. Whoever asks from ROS 2 has the
rights of a student. A service is offered as long as a part that is registered holds the slot that serves it.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
from collections.abc import Callable
from functools import partial
from typing import Final

from msbot.master.ros_services import SERVICE, RosService
from msbot.operations.dispatch import InProcessOperations
from msbot.operations.rights import Principal
from msbot.ros.ros_log import ERROR, RosLog
from msbot.sim.model_part import message_class
from msbot_agent.ros.node_names import NodeName
from msbot_agent.space import Owner, Reader, Sample, Space, Writer
from msbot_xrce.counting import Tally
from msbot_xrce.errors import MsbotError, RemoteProtocolError

MOST_OPEN: Final = 16
"""Requests of ROS 2 that wait for their parts at once; further ones are refused."""
LONGEST_S: Final = 60.0
"""How long a part may take for its reply; a node of ROS 2 does not say how long it waits."""

logger = logging.getLogger(__name__)


class ServiceServer:
    """Answers for the parts of one robot. Must be made on its event loop.

    Args:
        operations: calls the parts.
        space: where the services are.
        asker: on whose behalf.
        log: where refusals are told that no reply can tell.
    """

    def __init__(self, operations: InProcessOperations, space: Space, asker: Principal, log: RosLog) -> None:
        self._operations = operations
        self._space = space
        self._asker = asker
        self._log = log
        self._offered: dict[str, list[Reader | Writer]] = {}
        self._open: set[asyncio.Task[None]] = set()
        self.refused = Tally()
        """Requests without a reply of the part, by the reason in words."""

    def offer(self, service: RosService, node: NodeName) -> None:
        """Offer a service under that node; nothing happens if it is offered."""
        if service.name in self._offered:
            return
        owner = Owner(participant=str(node))
        writer = self._space.writer(service.replies, SERVICE, secrets.token_bytes(16), owner)
        take = partial(self._take, service, node, writer)
        self._offered[service.name] = [writer, self._space.reader(service.requests, SERVICE, take, owner)]

    def withdraw(self, service: RosService) -> None:
        """Offer a service no longer."""
        for end in self._offered.pop(service.name, ()):
            end.close()

    def close(self) -> None:
        """Offer nothing any more, and wait for no part."""
        for ends in self._offered.values():
            for end in ends:
                end.close()
        self._offered.clear()
        for task in self._open:
            task.cancel()

    def _take(self, service: RosService, node: NodeName, writer: Writer, sample: Sample) -> bool:
        def reply(octets: bytes) -> None:
            writer.write(octets, (sample.writer, sample.sequence_nr))

        if len(self._open) >= MOST_OPEN:
            self._refuse(service, node, f"{MOST_OPEN} requests of ROS 2 wait for replies already", reply)
            return True
        task = asyncio.get_running_loop().create_task(self._answer(service, node, sample.payload, reply))
        self._open.add(task)
        task.add_done_callback(self._open.discard)
        return True

    async def _answer(
        self, service: RosService, node: NodeName, request: bytes, reply: Callable[[bytes], None]
    ) -> None:
        try:
            octets = await self._asked(service, request)
        except MsbotError as error:
            self._refuse(service, node, str(error), reply)
        else:
            reply(octets)

    async def _asked(self, service: RosService, request: bytes) -> bytes:
        library = self._operations.library
        known = None if library is None else library.messages.get(service.kind.request)
        if known is None:
            raise RemoteProtocolError(f"the library does not know {service.kind.request} any more")
        message = message_class(known).decode(service.form.request_inward(request))
        port = str(service.binding.source)
        told = await self._operations.call_with(port, message, LONGEST_S, who=self._asker)
        return service.form.reply_outward(told.encode())

    def _refuse(self, service: RosService, node: NodeName, why: str, reply: Callable[[bytes], None]) -> None:
        words = f"request of ROS 2 to {service.name}: {why}"
        if why not in self.refused:
            logger.warning("%s", words)
        self.refused.count(why)
        self._log.write(node, ERROR, words)
        if (octets := service.form.refusal(why)) is not None:
            reply(octets)

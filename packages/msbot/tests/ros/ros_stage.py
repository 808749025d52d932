"""A robot in virtual time with its ROS 2 side, and a client of ROS beside it; the data space is memory."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator, Mapping
from typing import Any, TypeVar

from msbot.operations.dispatch import InProcessOperations
from msbot.part import Message
from msbot.ros.parameter_server import SERVICE
from msbot.ros.robot_in_ros import RobotInRos
from msbot_agent.ros import discovery_info
from msbot_agent.ros.discovery_info import SINCE_IRON, decode
from msbot_agent.ros.node_names import topic_of
from msbot_agent.space import Guid, MemorySpace, OwnEndpoint, Owner, Qos, Reader, Sample, Space, Topic, Writer
from tests.operations.stage import Stage

_M = TypeVar("_M", bound=Message)


class SharedMemory:
    """A space in memory that tells its endpoints as one in DDS does."""

    def __init__(self, space: Space) -> None:
        self.words: str | None = "shared"
        self._space = space
        self._readers = 0
        self._here: dict[_End, OwnEndpoint] = {}

    def participants(self) -> Mapping[int, Guid]:
        return {0: b"participant here"}

    def endpoints(self) -> Iterator[OwnEndpoint]:
        return iter(self._here.values())

    def on_endpoints(self, listener: Callable[[], object]) -> None:
        """Nothing that these tests look at changes without something else."""

    def writer(self, topic: Topic, qos: Qos, guid: Guid, owner: Owner = Owner()) -> Writer:  # noqa: B008
        endpoint = OwnEndpoint(owner, 0, topic.name, topic.type_name, guid, is_writer=True)
        writer: Writer = self._remember(self._space.writer(topic, qos, guid), endpoint)
        return writer

    def reader(
        self,
        topic: Topic,
        qos: Qos,
        deliver: Callable[[Sample], bool],
        owner: Owner = Owner(),  # noqa: B008
    ) -> Reader:
        self._readers += 1
        guid = self._readers.to_bytes(16, "big")
        endpoint = OwnEndpoint(owner, 0, topic.name, topic.type_name, guid, is_writer=False)
        reader: Reader = self._remember(self._space.reader(topic, qos, deliver), endpoint)
        return reader

    def _remember(self, inner: Writer | Reader, endpoint: OwnEndpoint) -> Any:
        end = _End(inner, self._here)
        self._here[end] = endpoint
        return end


class _End:
    """A writer or reader that is forgotten when it is closed."""

    def __init__(self, inner: Writer | Reader, known: dict[_End, OwnEndpoint]) -> None:
        self._inner = inner
        self._known = known

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    def close(self) -> None:
        self._known.pop(self, None)
        self._inner.close()


class RosStage:
    """A robot of `tests.operations.stage` in ROS."""

    def __init__(self, stage: Stage, *, description: str = "", operations: InProcessOperations | None = None) -> None:
        self.stage = stage
        self.space = stage.master.space
        assert isinstance(self.space, MemorySpace)
        self.shared = SharedMemory(self.space)
        self.robot = RobotInRos(
            stage.master,
            operations or stage.operations,
            self.shared,
            description=description,
            epoch_ns=lambda: round(1_000_000_000 * stage.now()),
        )
        assert stage.tasks is not None
        self._running = stage.tasks.create_task(self.robot.run())
        self.heard: dict[str, list[bytes]] = {}
        self._told: list[bytes] = []
        self._number = 0
        told = Topic(discovery_info.TOPIC, discovery_info.TYPE)
        self.space.reader(told, Qos(transient_local=True), self._keep(self._told))

    def end(self) -> None:
        """Nobody is in ROS any more."""
        self._running.cancel()

    def nodes(self) -> list[str]:
        """The names of the nodes that were told last."""
        return [str(node.name) for node in decode(self._told[-1], SINCE_IRON)[1]]

    def readers(self) -> dict[str, frozenset[Guid]]:
        """Whose readers each node has, as was told last."""
        return {str(node.name): frozenset(node.readers) for node in decode(self._told[-1], SINCE_IRON)[1]}

    def listen(self, topic: str, message: type[_M], *, late: bool = False) -> Callable[[], list[_M]]:
        """What comes on a topic of the robot, or with `/` in front of all; `late`: also what was kept."""
        name = topic_of(self.stage.master.blueprint.robot.name, topic)
        came: list[bytes] = []
        self.space.reader(Topic(name, message.type_name), Qos(transient_local=late), self._keep(came))
        return lambda: [message.decode(payload) for payload in came]

    async def ask(self, node: str, service: str, request: Message | bytes, reply: type[_M]) -> _M:
        """The reply of a parameter service."""
        came = await self.try_to_ask(node, service, request, reply)
        assert came is not None, "nobody has answered"
        return came

    async def try_to_ask(self, node: str, service: str, request: Message | bytes, reply: type[_M]) -> _M | None:
        """The same, None if there is no reply within a second."""
        came: list[bytes] = []
        self._number += 1
        octets = request if isinstance(request, bytes) else request.encode()
        asked = reply.type_name.replace("_Response_", "_Request_")
        me = self._number.to_bytes(16, "little")

        def take(sample: Sample) -> bool:
            if sample.related == (me, 1):
                came.append(sample.payload)
            return True

        reader = self.space.reader(Topic(f"rr{node}/{service}Reply", reply.type_name), SERVICE, take)
        writer = self.space.writer(Topic(f"rq{node}/{service}Request", asked), SERVICE, me)
        writer.write(octets)
        for _ in range(100):
            if came:
                break
            await asyncio.sleep(0.01)
        reader.close()
        writer.close()
        return reply.decode(came[0]) if came else None

    @staticmethod
    def _keep(into: list[bytes]) -> Callable[[Sample], bool]:
        def keep(sample: Sample) -> bool:
            into.append(sample.payload)
            return True

        return keep

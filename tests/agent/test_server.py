"""The agent as clients and operators see it: sessions, samples, links, silence."""

from __future__ import annotations

import pytest

from msbot.agent import Agent, ClientInfo, OpenGate
from msbot.link.virtual_time import run_virtual
from msbot.space import MemorySpace
from msbot.xrce import STREAM_BEST_EFFORT, STREAM_RELIABLE
from tests.agent.wiring import WiredClient, serving


class RememberingGate(OpenGate):
    """Lets everybody in and remembers who came and went."""

    def __init__(self) -> None:
        self.events: list[str] = []

    def joined(self, client: ClientInfo) -> None:
        self.events.append(f"{client.key} joined")

    def left(self, client: ClientInfo, reason: str) -> None:
        self.events.append(f"{client.key} left: {reason}")


@pytest.mark.parametrize("stream_id", [STREAM_RELIABLE, STREAM_BEST_EFFORT])
def test_samples_of_one_client_reach_another(stream_id: int) -> None:
    async def scenario() -> None:
        agent = Agent(MemorySpace())
        async with serving(agent) as link:
            writer, reader = WiredClient(link, key=1), WiredClient(link, key=2)
            await writer.connect()
            await reader.connect()
            target = await reader.add_reader("light", stream_id=stream_id)
            source = await writer.add_writer("light")
            await writer.write(source, b"one", b"two", b"", stream_id=stream_id)
            assert reader.received(target) == [b"one", b"two", b""]
            assert agent.topics() == [("light", 3, 3)]

    run_virtual(scenario())

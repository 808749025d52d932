"""What the tests of the whole agent share: a gate that remembers, and scenes in virtual time."""

from __future__ import annotations

from collections.abc import Awaitable, Callable

from msbot.process.virtual_time import run_virtual
from msbot_agent.agent import Agent, AgentSettings, AgentSignalHandler, ClientInfo, OpenGate
from msbot_agent.space import MemorySpace
from msbot_xrce.objects import EndpointQos
from tests.agent.wiring import FakeLink, WiredClient, serving

LATCHED = EndpointQos(transient_local=True, depth=1)


class StrictGate(OpenGate):
    """Bars topics by client key, and remembers who came and went."""

    def __init__(self) -> None:
        self.barred: set[tuple[int, str]] = set()
        self.asked = 0
        self.events: list[str] = []

    def joined(self, client: ClientInfo) -> None:
        self.events.append(f"{client.key} joined from {client.address}")

    def session_ended(self, client: ClientInfo, reason: str) -> None:
        self.events.append(f"{client.key} left: {reason}")

    def may_write(self, client: ClientInfo, topic: str) -> bool:
        self.asked += 1
        return (client.key, topic) not in self.barred

    def may_read(self, client: ClientInfo, topic: str) -> bool:
        self.asked += 1
        return (client.key, topic) not in self.barred


Scenario = Callable[[Agent, FakeLink], Awaitable[None]]


def play(
    scenario: Scenario,
    *,
    gate: OpenGate | None = None,
    settings: AgentSettings | None = None,
    signal: AgentSignalHandler | None = None,
) -> None:
    """Run a scenario with an agent on one fake link, in virtual time."""

    async def main() -> None:
        agent = Agent(MemorySpace(), gate=gate, settings=settings, epoch_ns=lambda: 5_000_000_000, signal=signal)
        async with serving(agent) as link:
            await scenario(agent, link)

    run_virtual(main())


async def connected(link: FakeLink, *keys: int, mtu: int = 512) -> list[WiredClient]:
    """Clients with a session."""
    clients = [WiredClient(link, key=key, mtu=mtu) for key in keys]
    for client in clients:
        await client.connect()
    return clients

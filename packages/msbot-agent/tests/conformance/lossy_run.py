"""A stock client writes over a network that loses and reorders, in virtual time."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from random import Random

from msbot.process.virtual_time import run_virtual
from msbot_agent.agent import Agent
from msbot_agent.space import MemorySpace
from msbot_xrce.streams.receiving_in_order import GIVEN_UP
from tests.agent.wiring import FakeLink, serving
from tests.conformance.c_client import CClient, Wire

LIMIT_S = 60.0


@dataclass(frozen=True, slots=True)
class Outcome:
    """What became of the samples."""

    arrived: int
    given_up: int
    """Messages that the agent gave up."""
    emptied: int
    """ACKNACKs that emptied the writer's history."""
    acknacks: int
    """ACKNACKs that the writer got."""
    is_over: bool
    """Whether the writer had everything acknowledged in time."""


def write_over(seed: int, *, drop: float, reorder: float, samples: int = 100, slice_s: float = 0.01) -> Outcome:
    """One client writes every 10 ms over a bad network, the other one reads over a good one."""
    random = Random(seed)
    outcomes: list[Outcome] = []

    async def main() -> None:
        agent = Agent(MemorySpace())
        async with serving(agent, FakeLink(keeps_order=False)) as link:
            good = (Wire(random, drop=0.0), Wire(random, drop=0.0))
            bad = (Wire(random, drop=drop, reorder=reorder), Wire(random, drop=drop, reorder=reorder))
            reader = CClient(link, 2, good, history=16, slice_s=0.01)
            writer = CClient(link, 1, bad, history=8, slice_s=slice_s)
            await reader.log_in()
            await reader.read()
            is_over = True
            try:
                async with asyncio.timeout(LIMIT_S):
                    await writer.log_in()
                    for number in range(samples):
                        await writer.write(number.to_bytes(2, "big"))
                        await asyncio.sleep(0.01)
                    await writer.confirm()
            except TimeoutError:
                is_over = False
            assert reader.samples == sorted(set(reader.samples)), "each once, and in order"
            views = [view.dropped.get(GIVEN_UP, 0) for view in agent.clients() if view.key == 1]
            outcomes.append(Outcome(len(reader.samples), sum(views), writer.output.emptied, writer.acknacks, is_over))

    run_virtual(main())
    return outcomes[0]

"""Our agent between two clients that behave as eProsima's C client does, over networks that lose and double packets."""

from __future__ import annotations

import asyncio
from functools import partial
from random import Random

import pytest

from msbot.agent import Agent
from msbot.runtime.virtual_time import run_virtual
from msbot.space import MemorySpace
from tests.agent.wiring import serving
from tests.conformance.c_client import CClient, until

READER_DEPTH = 16


@pytest.mark.parametrize("seed", range(24))
def test_every_sample_once_and_in_order_and_nobody_is_ruined(seed: int) -> None:
    random = Random(seed)
    drop, duplicate = (0.0, 0.05, 0.15, 0.3)[seed % 4], (0.0, 0.1)[seed // 4 % 2]

    async def main() -> None:
        async with serving(Agent(MemorySpace())) as link:
            one, other = (
                CClient(link, key, history=random.choice((4, 8, 16)), random=random, drop=drop, duplicate=duplicate)
                for key in (1, 2)
            )
            for client in (one, other):
                await client.log_in()
                assert list(client.statuses.values()) == [0] * 6
            await other.read()
            sent = [bytes([number]) * random.choice((1, 40, 400, 487, 900, 1500)) for number in range(100)]

            def reader_is_near(number: int) -> bool:
                return number - len(other.samples) <= READER_DEPTH - 4

            for number, sample in enumerate(sent):
                await one.write(sample)
                await until(partial(reader_is_near, number))
            async with asyncio.timeout(120):
                await until(lambda: len(other.samples) >= len(sent))
            await asyncio.sleep(3.0)
            assert other.samples == sent
            assert (one.ruined, other.ruined) == (0, 0)

    run_virtual(main())

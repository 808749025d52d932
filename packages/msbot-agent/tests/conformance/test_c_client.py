"""Our agent between two clients that behave as stock C clients do, over networks that lose, double and reorder."""

from __future__ import annotations

import asyncio
import itertools
from functools import partial
from random import Random

import pytest

from msbot.process.virtual_time import run_virtual
from msbot_agent.agent import Agent
from msbot_agent.space import MemorySpace
from tests.agent.wiring import FakeLink, serving
from tests.conformance.c_client import CClient, Wire, until
from tests.conformance.lossy_run import write_over

READER_DEPTH = 16


@pytest.mark.parametrize("seed", range(24))
def test_every_sample_once_and_in_order_and_no_history_is_emptied(seed: int) -> None:
    random = Random(seed)
    drop, duplicate = (0.0, 0.05, 0.15, 0.3)[seed % 4], (0.0, 0.1)[seed // 4 % 2]
    slice_s = (0.005, 0.1)[seed // 8 % 2]

    async def main() -> None:
        async with serving(Agent(MemorySpace()), FakeLink(keeps_order=False)) as link:
            one, other = (
                CClient(
                    link,
                    key,
                    (Wire(random, drop=drop, duplicate=duplicate), Wire(random, drop=drop, duplicate=duplicate)),
                    history=random.choice((4, 8, 16)),
                    slice_s=slice_s,
                )
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
            await one.confirm()
            await asyncio.sleep(3.0)
            assert other.samples == sent
            assert (one.output.emptied, other.output.emptied) == (0, 0)

    run_virtual(main())


@pytest.mark.parametrize("slice_s", [0.01, 0.1])
@pytest.mark.parametrize(("drop", "reorder"), list(itertools.product((0.0, 0.1, 0.2, 0.3), (0.1, 0.2))))
def test_a_network_that_loses_and_reorders_stops_nobody(drop: float, reorder: float, slice_s: float) -> None:
    for seed in range(3):
        outcome = write_over(seed, drop=drop, reorder=reorder, slice_s=slice_s)
        assert outcome.is_over
        assert outcome.arrived + outcome.given_up >= 100
        assert outcome.arrived >= (100 if not drop else 90)


def test_a_gap_makes_no_storm_of_acknacks() -> None:
    outcome = write_over(0, drop=0.2, reorder=0.2)
    assert outcome.acknacks < 500, "100 samples, and 6 objects"

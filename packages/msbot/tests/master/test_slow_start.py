"""A computer that is slow or busy: the master waits for its own agent, and does not end and begin anew."""

from __future__ import annotations

import asyncio
from random import Random

import pytest

from msbot.config import Blueprint, RobotProfile
from msbot.master import Master
from msbot.pnp import MemoryStore
from msbot.process.virtual_time import run_virtual
from msbot_agent.link import InprocHub


def test_a_master_waits_for_its_own_agent(monkeypatch: pytest.MonkeyPatch) -> None:
    async def main() -> None:
        master = Master(Blueprint(RobotProfile("R", "1", "2", "3", "4"), ()), MemoryStore(), random=Random(3))
        master.add_link(InprocHub().server)
        begin = master.agent.run

        async def late() -> None:
            await asyncio.sleep(60.0)
            await begin()

        monkeypatch.setattr(master.agent, "run", late)
        running = asyncio.create_task(master.run())
        await asyncio.sleep(59.0)
        assert not running.done()
        assert not master.ready.is_set()
        await asyncio.sleep(21.0)
        assert master.ready.is_set()
        running.cancel()
        with pytest.raises(asyncio.CancelledError):
            await running

    run_virtual(main())

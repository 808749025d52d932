"""A worker that stays: the same process answers again, ends by itself, and gives way to another when it fails."""

from __future__ import annotations

import asyncio
import os
import sys

import pytest

from msbot.process.persistent_worker import MOST_WAITING, PersistentWorker
from msbot.process.worker_pool import TooMuchWork, WorkLimits
from msbot_xrce.errors import ConfigError
from tests.runtime.work import chatter, eat_memory, eat_time, fail, process_number, refuse

has_limits = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limits for processes")
LIMITS = WorkLimits(cpu_s=1, memory_mb=300, wall_s=120.0)  # beside other work a second of processor time takes long


async def test_one_process_answers_everything_and_the_loop_goes_on() -> None:
    worker = PersistentWorker(LIMITS)
    assert not worker.is_there
    first = asyncio.get_running_loop().create_task(worker.run(process_number))
    turns = 0
    while not first.done():
        turns += 1
        await asyncio.sleep(0)
    assert turns > 100
    assert first.result() != os.getpid()
    assert await worker.run(chatter) == "done"
    with pytest.raises(ConfigError, match="no such thing"):
        await worker.run(refuse, "no such thing")
    with pytest.raises(RuntimeError, match="'a bug'"):
        await worker.run(fail)
    assert await worker.run(process_number) == first.result()
    worker.end()
    assert not worker.is_there


@has_limits
async def test_who_needs_too_much_is_ended_and_the_next_call_goes_well() -> None:
    worker = PersistentWorker(LIMITS)
    with pytest.raises(TooMuchWork, match="300 MB"):
        await worker.run(eat_memory)
    with pytest.raises(TooMuchWork, match="1 s of processor time"):
        await worker.run(eat_time)
    assert await worker.run(process_number) != os.getpid()
    worker.end()
    hurried = PersistentWorker(WorkLimits(cpu_s=60, wall_s=0.2))
    with pytest.raises(TooMuchWork, match=r"within 0\.2 s; this computer may have too much to do"):
        await hurried.run(eat_time)


async def test_too_many_are_refused_and_idleness_ends_it() -> None:
    worker = PersistentWorker(LIMITS, idle_s=0.5)
    asked = [asyncio.get_running_loop().create_task(worker.run(process_number)) for _ in range(MOST_WAITING + 1)]
    await asyncio.sleep(0)
    with pytest.raises(ConfigError, match="busy"):
        await worker.run(process_number)
    assert len(set(await asyncio.gather(*asked))) == 1
    while worker.is_there:  # noqa: ASYNC110 - a process that ends tells no event
        await asyncio.sleep(0.01)

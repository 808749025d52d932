"""A few seconds of `bench/soak.py` with real processes; its oracle is tested in `test_soak_oracle.py`."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from bench.soaking.acts import Acts
from bench.soaking.scene import Scene

pytestmark = [
    pytest.mark.skipif(sys.platform != "linux", reason="it looks into /proc"),
    pytest.mark.timeout(300),
]
PATIENCE_S = 120.0


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110 - processes tell nobody
            await asyncio.sleep(0.05)


async def test_a_killed_part_a_cut_one_a_killed_master_and_what_people_do(tmp_path: Path) -> None:
    said: list[str] = []
    scene = Scene(tmp_path, ["udp", "tcp"], "key", 1, said.append)
    acts = Acts(scene)
    acts._while = lambda least, most: 0.2  # type: ignore[method-assign]

    async def hear_again() -> None:
        before = scene.samples.heard
        await until(lambda: scene.is_well() and scene.samples.heard > before + 4)

    watching = asyncio.create_task(scene.watch())
    try:
        await scene.begin(intruders=1)
        await hear_again()
        await asyncio.gather(acts.kill_part("S0"), acts.cut_part("S1"), acts.set_note("S1"))
        await hear_again()
        await asyncio.gather(acts.kill_master(""), acts.stop(""), acts.rewire("S0"))
        await hear_again()
        await until(lambda: scene.states.parts["S1"].told_note == (scene.states.parts["S1"].note or ("",))[0])
        await scene.read_journal()
        assert not watching.done()
    finally:
        watching.cancel()
        await asyncio.gather(watching, return_exceptions=True)
        await scene.robot.close()
    scene.judge_all()
    assert said == []
    assert scene.journal.lines > 4
    assert scene.pages > 0
    assert scene.robot.intruders
    assert len(scene.acknowledged) >= 3
    assert {"part killed", "master killed"} <= scene.back.keys()

"""Between processes: reliable means reliable, floods and crashes do no harm."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import sys
from functools import partial
from pathlib import Path

import pytest

from msbot_agent.space import Qos, Topic
from msbot_agent.space.dds import DdsSpace
from tests.skewed_clock import skewed
from tests.space.dds.far_side import numbered
from tests.space.dds.peers import Inbox, arrived, far_side, program, until

TOPIC = Topic("t", "T")


async def test_a_reader_that_keeps_all_makes_the_writer_wait_and_loses_nothing() -> None:
    count = 3000
    with DdsSpace() as space:
        inbox = Inbox(takes=False)
        reader = space.reader(TOPIC, Qos(keep_all=True, depth=256), inbox)
        async with far_side(
            do="write", topic="t", type="T", qos={"keep_all": True, "depth": 4000}, count=count
        ) as writer:
            await writer.says("done")
            got: list[bytes] = []
            while len(got) < count:
                sample = reader.take()
                if sample is None:
                    await asyncio.sleep(0.001)
                else:
                    got.append(sample.payload)
        assert got == [numbered(index, 8) for index in range(count)]
        assert reader.lost == 0


async def test_large_samples_arrive_whole() -> None:
    with DdsSpace() as space:
        inbox = Inbox()
        space.reader(TOPIC, Qos(), inbox)
        async with far_side(do="write", topic="t", type="T", count=5, size=1 << 20):
            await until(lambda: len(inbox.samples) == 5)
        assert inbox.payloads == [numbered(index, 1 << 20) for index in range(5)]


async def test_a_peer_that_crashes_in_the_middle_of_a_sample_leaves_nothing_behind() -> None:
    with DdsSpace() as space:
        inbox = Inbox()
        most = 64  # as many as may wait: of more, a reader that is too slow would rightly miss the oldest
        reader = space.reader(TOPIC, Qos(depth=most), inbox)
        async with far_side(do="write", topic="t", type="T", qos={"depth": most}, count=most, size=1 << 20) as writer:
            await until(lambda: len(inbox.samples) >= 3)
            writer.process.kill()
            await writer.process.wait()
        # What was written before the two had found each other on both sides is not for this reader.
        first = int.from_bytes(inbox.payloads[0][:4], "big")
        whole = [numbered(first + index, 1 << 20) for index in range(len(inbox.samples))]
        assert inbox.payloads == whole
        count = len(inbox.samples)
        async with far_side(do="write", topic="t", type="T", count=3, size=8):
            await until(lambda: inbox.payloads[-3:] == [numbered(index, 8) for index in range(3)])
        assert len(inbox.samples) >= count + 3
        assert reader.troubles() == ()


async def test_a_flooding_peer_takes_neither_the_loop_nor_the_memory() -> None:
    with DdsSpace() as space:
        flooded = Inbox(takes=False)
        reader = space.reader(TOPIC, Qos(reliable=False, depth=8), flooded)
        calm = Inbox()
        space.reader(Topic("calm_back", "T"), Qos(depth=32), calm)
        asks = space.writer(Topic("calm", "T"), Qos(depth=32), bytes(16))
        async with (
            far_side(do="write", topic="t", type="T", qos={"reliable": False}, size=64),
            far_side(do="echo", topic="calm", type="T"),
        ):
            await until(lambda: reader.lost > 1000)
            await until(lambda: (asks.write(b"are you there"), calm.samples)[1])
            for number in range(20):
                asks.write(b"%d" % number)
                await until(partial(arrived, calm, b"%d" % number))
            lost = reader.lost
            await until(lambda: reader.lost > lost)  # it went on flooding meanwhile
        kept = []
        while (sample := reader.take()) is not None:
            kept.append(sample)
        assert len(kept) <= 8


async def test_a_reader_elsewhere_that_stops_reading_does_not_hold_up_this_side() -> None:
    with DdsSpace() as space:
        writer = space.writer(TOPIC, Qos(keep_all=True, depth=16), bytes(16))
        back = Inbox()
        space.reader(Topic("t_back", "T"), Qos(), back)
        async with far_side(do="echo", topic="t", type="T", qos={"keep_all": True, "depth": 16}) as echo:
            await until(lambda: (writer.write(b"first"), back.samples)[1])
            os.kill(echo.process.pid, signal.SIGSTOP)
            for _ in range(1000):  # far more than both ends have room for; every write returns at once
                writer.write(bytes(20_000))
            assert "samples were lost: a DDS peer does not acknowledge in time" in writer.troubles()[-1]
            for number in range(16):
                writer.write(b"last %d" % number)
            os.kill(echo.process.pid, signal.SIGCONT)
            await until(lambda: b"last 15" in back.payloads)
        last = [payload for payload in back.payloads if payload.startswith(b"last")]
        assert last == [b"last %d" % number for number in range(16)]  # what waited was the newest


@pytest.mark.parametrize("reliable", [True, False])
async def test_samples_of_one_writer_stay_in_order(reliable: bool) -> None:
    with DdsSpace() as space:
        inbox = Inbox()
        space.reader(TOPIC, Qos(reliable=reliable, depth=64), inbox)
        async with far_side(do="write", topic="t", type="T", qos={"reliable": reliable}, count=5000) as writer:
            await writer.says("done")
            if reliable:
                await until(lambda: inbox.payloads and inbox.payloads[-1] == numbered(4999, 8))
            else:
                await until(lambda: len(inbox.samples) > 100)
        assert inbox.payloads == sorted(set(inbox.payloads))


@pytest.mark.parametrize("seconds", [-7200, 86400])
async def test_a_peer_whose_clock_is_wrong_is_heard_and_hears(seconds: int, tmp_path: Path) -> None:
    """Also with a lifespan: its time runs from when a sample came, not from what the writer's clock said."""
    wish = {"do": "echo", "topic": "Old", "type": "T", "qos": {"lifespan_s": 5.0, "depth": 64}}
    command = (sys.executable, str(Path(__file__).with_name("far_side.py")), json.dumps(wish))
    qos = Qos(lifespan_s=5.0, depth=64)
    with DdsSpace() as space:
        inbox = Inbox()
        space.reader(Topic("Old_back", "T"), qos, inbox)
        writer = space.writer(Topic("Old", "T"), qos, bytes(16))
        async with program(*command, environment=skewed(tmp_path, seconds)):
            await until(lambda: (writer.write(b"are you there"), inbox.payloads)[1])
            inbox.samples.clear()
            for number in range(50):
                writer.write(bytes([number]))
            await until(lambda: arrived(inbox, bytes([49])))
            assert [one for one in inbox.payloads if len(one) == 1] == [bytes([number]) for number in range(50)]

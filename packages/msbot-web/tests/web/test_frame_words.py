"""Whoever opens the bus page late understands the frames all the same: the master knows topics and types."""

from __future__ import annotations

import asyncio
import csv
from functools import partial
from pathlib import Path
from random import Random

from msbot.config import load_blueprint, load_library, write_sample
from msbot.operations.blocking import known_object
from msbot.process.virtual_time import run_virtual
from msbot.registry import open_registry
from msbot_agent.link.can.protocol import parse_log_line
from msbot_school.demo import DemoLinkKind, DemoRobot
from msbot_web.frame_ring import FrameRing


def heard_late(tmp_path: Path) -> FrameRing:
    """The frames of the thesis' robot, listened to from its 75th second on."""

    async def main() -> FrameRing:
        ring = FrameRing()
        write_sample(tmp_path / "robot.toml")
        library = load_library()
        blueprint = load_blueprint(tmp_path / "robot.toml", library)
        with open_registry(tmp_path / "robot.db") as registry:
            store = registry.runs.begin(registry.robots.apply_blueprint(blueprint, library))
            robot = DemoRobot(blueprint, store, wire=DemoLinkKind.CAN, random=Random(1), epoch_ns=lambda: 0)
            async with asyncio.TaskGroup() as tasks:
                running = tasks.create_task(robot.run())
                await robot.master.ready.wait()
                await asyncio.sleep(75.0)
                ring.learn((), partial(known_object, robot.master))
                robot.on_frame(ring.tap)
                await asyncio.sleep(4.0)
                ring.rows()
                robot.finish()
                await running
        return ring

    return run_virtual(main())


def test_after_75_seconds_every_sample_is_said_in_plain_words_and_every_beat_is_understood(tmp_path: Path) -> None:
    ring = heard_late(tmp_path)
    rows = ring.rows(limit=2000)
    said = [line for row in rows for line in row.plain]
    assert any(line.startswith("AA says out index ") and "Publisher A" in line for line in said)
    assert any(line.startswith("BB hears in index ") for line in said)
    assert all(row.plain or row.about for row in rows), "every frame is said in words for everybody"
    about = {line for row in rows for line in row.about}
    assert {"BB says that it is alive", "the master has heard that BB is alive"} <= about
    assert {"the master says that it is there", "BB has received everything so far"} <= about
    packets = [row for row in rows if len(row.words) > 1]
    assert len(packets) > 20
    assert not [row.words for row in packets if any("unknown topic" in line for line in row.words)]
    assert any("request of msbot_inventory" in line for row in packets for line in row.words)


def test_the_frames_are_saved_as_candump_and_as_a_table(tmp_path: Path) -> None:
    ring = heard_late(tmp_path)
    lines = list(ring.candump("sim0", epoch_s=1000.0))
    assert len(lines) == min(ring.total, 4000)
    first = parse_log_line(lines[0])
    assert first is not None
    assert (first.channel, first.at is not None and first.at > 1075.0) == ("sim0", True)
    head, *table = csv.reader(ring.csv())
    assert head == ["number", "seconds", "sender", "frame", "plain", "protocol"]
    assert len(table) == len(lines)
    assert any(row[4].startswith("AA says out index ") for row in table)

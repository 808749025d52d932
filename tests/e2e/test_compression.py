"""Header compression in a whole robot: what goes over the bus, and who does without."""

from __future__ import annotations

import asyncio
from pathlib import Path
from random import Random

from msbot.config import load_blueprint, load_library, write_sample
from msbot.process.virtual_time import run_virtual
from msbot.registry import open_registry
from msbot_agent.link.can.protocol import Frame
from msbot_agent.link.can.protocol.frames import FIRST, LAST
from msbot_agent.link.can.protocol.ids import CanIds
from msbot_school.demo import DemoLinkKind, DemoRobot, DemoSnapshot

Seen = list[tuple[float, Frame]]


def run(folder: Path, *, seconds: float, compression: bool = True) -> tuple[Seen, DemoSnapshot]:
    """Part AA alone in the sample robot on classic CAN: the frames of packets with their times, and how it ended."""

    async def main() -> tuple[Seen, DemoSnapshot]:
        write_sample(folder / "robot.toml")
        library = load_library()
        blueprint = load_blueprint(folder / "robot.toml", library)
        with open_registry(folder / "robot.db") as registry:
            robot = DemoRobot(
                blueprint,
                registry.runs.begin(registry.robots.apply_blueprint(blueprint, library)),
                wire=DemoLinkKind.CAN,
                compression=compression,
                names=("AA",),
                random=Random(1),
                epoch_ns=lambda: 0,
            )
            seen: Seen = []
            ids = CanIds()
            async with asyncio.TaskGroup() as tasks:
                running = tasks.create_task(robot.run())
                await robot.master.ready.wait()
                start = asyncio.get_running_loop().time()
                robot.on_frame(
                    lambda at, _name, frame: (
                        seen.append((at - start, frame)) if ids.up < frame.can_id < 2 * ids.up else None
                    )
                )
                await asyncio.sleep(seconds)
                robot.finish()
                await running
            return seen, robot.snapshot()

    return run_virtual(main())


def test_a_part_is_active_after_35_frames_instead_of_110_and_a_beat_is_one_frame_each_way(tmp_path: Path) -> None:
    seen, snapshot = run(tmp_path, seconds=3.5)
    milliseconds = snapshot.parts[0].plug_in_to_active_ms
    assert milliseconds is not None
    assert milliseconds < 10
    before_active = [frame for at, frame in seen if at * 1000 < milliseconds]
    assert len(before_active) < 40
    up, down, alone = 0x101, 0x181, FIRST | LAST
    beats = [(at, frame) for at, frame in seen if frame.data[0] & alone == alone and frame.data[1] == 0x10]
    assert [frame.can_id for _, frame in beats] == [up] * 3
    for at, beat in beats:
        assert len(beat.data) == 8
        answer = next(frame for later, frame in seen if later > at)
        assert (answer.can_id, answer.data[1], len(answer.data)) == (down, 0x12, 7)


def test_without_compression_headers_go_as_they_are(tmp_path: Path) -> None:
    seen, snapshot = run(tmp_path, seconds=0.9, compression=False)
    assert snapshot.parts[0].state == "active"
    first = next(frame for _, frame in seen)
    assert first.data[1:] == bytes.fromhex("80000000000110")
    assert len(seen) > 150

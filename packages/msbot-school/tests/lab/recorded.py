"""A robot in virtual time with its recorder, and recordings to look into."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Mapping
from pathlib import Path
from random import Random

from msbot.config import load_blueprint, load_library, write_sample
from msbot.operations.dispatch import InProcessOperations
from msbot.process.virtual_time import run_virtual
from msbot.recording.recorder.batch import Item, Kind, RecordedChannel, Unpacker
from msbot.recording.recorder.measurements import keep_measuring
from msbot.recording.recorder.recorder import Recorder
from msbot.recording.recorder.recording_file import RingLimits
from msbot.recording.recorder.ring_storage import Storing
from msbot.recording.recordings.mcap_reader import RecordedMessage, RecordingReader
from msbot.registry import open_registry
from msbot_agent.space import MemorySpace
from msbot_school.demo import DemoRobot

NS = 1_000_000_000
BEGAN_NS = 1_700_000_000 * NS
LIMITS = RingLimits(100.0, 100 << 20)

Scene = Callable[[DemoRobot, InProcessOperations], Awaitable[None]]


def record_demo(
    folder: Path,
    target: Path,
    scene: Scene,
    names: tuple[str, ...] | None = None,
    sample: str = "thesis",
    *,
    shared: Mapping[str, str] | None = None,
    bag: Path | None = None,
) -> DemoRobot:
    """Run the thesis' ring, or another sample, or some of its slots, through a scene in virtual time.

    All is recorded in the target.

    Args:
        shared: topic -> what its binding says about ROS 2, in TOML.
        bag: is recorded at the same time, as a bag.
    """

    async def main() -> DemoRobot:
        write_sample(folder / "robot.toml", sample)
        text = (folder / "robot.toml").read_text()
        for topic, words in (shared or {}).items():
            line = f'topic = "{topic}"\n'
            assert line in text
            text = text.replace(line, f"{line}{words}\n")
        (folder / "robot.toml").write_text(text)
        library = load_library()
        blueprint = load_blueprint(folder / "robot.toml", library)
        loop = asyncio.get_running_loop()
        recorder = Recorder(loop.time, lambda: BEGAN_NS, library)
        with open_registry(folder / "robot.db") as registry:
            record = registry.robots.apply_blueprint(blueprint, library)
            robot = DemoRobot(
                blueprint,
                registry.runs.begin(record),
                node_ids=registry.runs.node_ids(record, "test"),
                names=names,
                random=Random(1),
                epoch_ns=lambda: BEGAN_NS,
                space=recorder.space(MemorySpace(clock=loop.time)),
            )
            operations = InProcessOperations(robot.master, registry, record, library=library)
            recorder.watch(robot.master, operations)
            async with asyncio.TaskGroup() as tasks:
                running = tasks.create_task(robot.run())
                measuring = tasks.create_task(
                    keep_measuring(robot.master.agent, robot.master.inventory.view, recorder.measured)
                )
                await robot.master.ready.wait()
                await scene(robot, operations)
                robot.finish()
                await running
                measuring.cancel()
        items = list(Unpacker().feed(recorder.drain()))
        store(items, target)
        if bag is not None:
            store(items, bag, as_bag=True)
        return robot

    return run_virtual(main())


def store(items: Iterable[Item], target: Path, *, as_bag: bool = False) -> list[str]:
    """Write records to one file, as the recorder's process does with `--rec FILE`; what is named as left out."""
    said: list[tuple[str, str]] = []
    left_out: list[str] = []
    ended: list[str] = []
    storing = Storing(
        None,
        LIMITS,
        lambda file, trouble: said.append((file, trouble)),
        on_left_out=lambda _file, topics: left_out.extend(topics),
        on_end=ended.append,
    )
    storing.take((Kind.START_BAG if as_bag else Kind.START, 0, 0, str(target).encode()), 0.0)
    for item in items:
        storing.take(item, 0.0)
    storing.close()
    assert said == []
    assert ended == [str(target)]
    return left_out


def channel(number: int, topic: str = "/t", **more: str) -> Item:
    """A record that declares a channel."""
    return (Kind.CHANNEL, number, 0, RecordedChannel(topic, "cdr", metadata=tuple(more.items())).encode())


def sample(number: int, at_s: float, content: bytes) -> Item:
    """A record with a sample."""
    return (Kind.SAMPLE, number, BEGAN_NS + round(at_s * NS), content)


def messages(path: Path) -> list[RecordedMessage]:
    """Everything in a file that must be whole."""
    reader = RecordingReader(path)
    found = list(reader.messages())
    assert reader.damage == ""
    return found

"""Lists that a part publishes, in a recording: shown, written as a table and replayed, they are the same ones."""

from __future__ import annotations

import asyncio
import csv
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from random import Random

import pytest
from click.testing import CliRunner

from msbot.cli.record.log import command
from msbot.config import Library, load_library, parse_blueprint
from msbot.master import Master
from msbot.operations.dispatch import InProcessOperations
from msbot.part import Message, Part
from msbot.part.messages.standard import Colour, Scan, Strip
from msbot.process.virtual_time import run_virtual
from msbot.recording.recorder.batch import Unpacker
from msbot.recording.recorder.recorder import Recorder
from msbot.recording.replay.replay_excerpt import read_excerpt
from msbot.recording.replay.replay_player import ReplayPlayer
from msbot.registry import open_registry
from msbot_agent.link import InprocHub, LinkInfo
from msbot_agent.space import MemorySpace
from tests.lab.recorded import BEGAN_NS, messages, store
from tests.operations.stage import put_database

EYE = """
number = "EYE-1"
name = "Eye"
[[port]]
name = "scan"
direction = "publish"
type = "Scan"
[[port]]
name = "strip"
direction = "publish"
type = "Strip"
"""
WALL = """
number = "WALL-1"
name = "Wall"
[[port]]
name = "scan"
direction = "subscribe"
type = "Scan"
[[port]]
name = "strip"
direction = "subscribe"
type = "Strip"
"""
ROBOT = """
[robot]
name = "ROVER"
[[slot]]
name = "eye"
part = "EYE-1"
[[slot]]
name = "wall"
part = "WALL-1"
[[binding]]
topic = "scan"
type = "Scan"
from = "eye.scan"
to = ["wall.scan"]
[[binding]]
topic = "strip"
type = "Strip"
from = "eye.strip"
to = ["wall.strip"]
"""
SCANS = [
    Scan(angle_min=-90.0, angle_step=0.5, reach=4.0, metres=[1.994, 0.1, 1 / 3, 16777215.0, 1e-30] + [2.5] * 355),
    Scan(angle_min=0.0, angle_step=1.0, reach=float("inf"), metres=[]),
    Scan(angle_min=0.1, angle_step=0.1, reach=8.5899345e9, metres=[0.30000001]),
]
STRIPS = [
    Strip(colours=[Colour(red=255, green=number, blue=0) for number in range(64)]),
    Strip(colours=[]),
    Strip(colours=[Colour(red=1, green=2, blue=3)]),
]
Scene = Callable[[Library, InprocHub], Awaitable[None]]


def record(folder: Path, name: str, scene: Scene) -> Path:
    """What a robot with an empty place for an eye records while a scene goes on."""

    async def main() -> None:
        loop = asyncio.get_running_loop()
        library = load_library(folder / "library")
        blueprint = parse_blueprint(ROBOT, library)
        recorder = Recorder(loop.time, lambda: BEGAN_NS, library)
        put_database(folder / f"{name}.db")
        with open_registry(folder / f"{name}.db") as registry:
            number = registry.robots.apply_blueprint(blueprint, library)
            space = recorder.space(MemorySpace(clock=loop.time))
            master = Master(blueprint, registry.runs.begin(number), space=space, library=library)
            operations = InProcessOperations(master, registry, number, library=library)
            recorder.watch(master, operations)
            hub = InprocHub()
            hub.server.info = LinkInfo("wire", 65535)
            master.add_link(hub.server)
            async with asyncio.TaskGroup() as tasks:
                running = [tasks.create_task(master.run())]
                await master.ready.wait()
                wall = Part("WALL-1")
                for port, kind in (("scan", Scan), ("strip", Strip)):
                    wall.on(port, kind)(lambda _: None)
                running.append(tasks.create_task(wall.run_async(hub.connect())))
                await scene(library, hub)
                for one in running:
                    one.cancel()
        store(Unpacker().feed(recorder.drain()), folder / f"{name}.mcap")

    run_virtual(main())
    return folder / f"{name}.mcap"


async def an_eye_looks(library: Library, hub: InprocHub) -> None:
    eye = Part("EYE-1")
    eye.publishes("scan", Scan)
    eye.publishes("strip", Strip)
    running = asyncio.ensure_future(eye.run_async(hub.connect()))
    await asyncio.sleep(5)
    for scan, strip in zip(SCANS, STRIPS, strict=True):
        eye.publish("scan", scan)
        eye.publish("strip", strip)
        await asyncio.sleep(0.5)
    eye.end()
    await running


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("robot")
    (folder / "library").mkdir()
    (folder / "library" / "eye.toml").write_text(EYE)
    (folder / "library" / "wall.toml").write_text(WALL)
    return folder


@pytest.fixture(scope="module")
def recording(folder: Path) -> Path:
    return record(folder, "first", an_eye_looks)


def said(path: Path, topic: str) -> list[bytes]:
    return [one.data[4:] for one in messages(path) if one.topic == topic and not one.is_repeated]


def octets(said: Sequence[Message]) -> list[bytes]:
    return [one.encode() for one in said]


def run(*arguments: str | Path) -> list[str]:
    told = CliRunner().invoke(command, [str(one) for one in arguments], catch_exceptions=False)
    assert told.exit_code == 0, told.output
    return told.stdout.splitlines()


def test_they_are_recorded_as_they_were_said(recording: Path) -> None:
    assert said(recording, "/scan") == octets(SCANS)
    assert said(recording, "/strip") == octets(STRIPS)


def test_they_are_shown_with_the_digits_that_they_have(recording: Path) -> None:
    shown = [line.split("  ")[-1] for line in run("show", recording, "--topic", "scan", "--topic", "strip")]
    many = ", ".join(["2.5"] * 11)
    assert shown[0] == (
        "eye: angle_min -90, angle_step 0.5, reach 4, "
        f"metres [1.994, 0.1, 0.3333333, 1.677722e+07, 1e-30, {many}, ... (360 in all)]"
    )
    assert shown[1].startswith("eye: colours [(red 255, green 0, blue 0), (red 255, green 1, blue 0), ")
    assert shown[1].endswith("(red 255, green 15, blue 0), ... (64 in all)]")
    assert shown[2:4] == ["eye: angle_min 0, angle_step 1, reach inf, metres []", "eye: colours []"]
    assert shown[5] == "eye: colours [(red 1, green 2, blue 3)]"


def test_a_table_has_each_element_whole(recording: Path, tmp_path: Path) -> None:
    run("export", recording, tmp_path / "a.csv")
    with (tmp_path / "a.csv").open(newline="") as stream:
        rows = [row for row in csv.DictReader(stream) if row["topic"] in ("/scan", "/strip")]
    table: dict[tuple[str, str], dict[str, str]] = {}
    for row in rows:
        table.setdefault((row["topic"], row["time_s"]), {})[row["field"]] = row["value"]
    scans = [one for (topic, _), one in table.items() if topic == "/scan"]
    for scan, fields in zip(SCANS, scans, strict=True):
        metres = [float(fields[f"metres[{place}]"]) for place in range(len(scan.metres))]
        assert fields.keys() == {"angle_min", "angle_step", "reach", *(f"metres[{n}]" for n in range(len(metres)))}
        again = Scan(metres=metres, **{name: float(fields[name]) for name in ("angle_min", "angle_step", "reach")})
        assert again.encode() == scan.encode()
    assert scans[0]["metres[0]"] == "1.994"
    strips = [one for (topic, _), one in table.items() if topic == "/strip"]
    for strip, fields in zip([one for one in STRIPS if one.colours], strips, strict=True):
        colours = [
            Colour(**{name: int(fields[f"colours[{place}].{name}"]) for name in ("red", "green", "blue")})
            for place in range(len(strip.colours))
        ]
        assert Strip(colours=colours) == strip


def test_they_are_replayed_as_they_were(recording: Path, folder: Path) -> None:
    piece = read_excerpt(recording, ["eye"])

    async def replay(library: Library, hub: InprocHub) -> None:
        told: list[str] = []
        player = ReplayPlayer(piece, say=told.append, warn=told.append, random=Random(7))
        await player.run(lambda _: hub.connect(), epoch_ns=lambda: BEGAN_NS)
        assert (player.published, told) == (len(SCANS) + len(STRIPS), ["The replay begins"])
        await asyncio.sleep(1)

    second = record(folder, "second", replay)
    assert said(second, "/scan") == octets(SCANS)
    assert said(second, "/strip") == octets(STRIPS)

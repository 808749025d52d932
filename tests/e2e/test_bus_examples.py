"""The examples for people who watch the bus, and the page that shows them."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from msbot_agent.link.can.protocol import CanIds, Frame
from msbot_agent.link.can.protocol.ids import NODES, Beacon, beacon_frame, read_beacon, stop_frame
from tests.e2e.processes import running

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples/bus/who_talks.py"
PAGE = (ROOT / "docs/howto/watch_the_bus.md").read_text()


def test_the_page_shows_the_example_as_it_is() -> None:
    assert EXAMPLE.read_text() in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert len(EXAMPLE.read_text().splitlines()) <= 15


def test_the_example_counts_the_frames_of_the_demo(tmp_path: Path) -> None:
    env = {"XDG_RUNTIME_DIR": str(tmp_path)}
    with running("demo", "--robot", "thesis", "--bus", "demo1", "--no-page", cwd=tmp_path, env=env) as demo:
        demo.wait_for("AA", "active")
        result = subprocess.run(
            [sys.executable, str(EXAMPLE)],
            env={**os.environ, **env},
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
        )
    counts = dict(line.split(": ") for line in result.stdout.splitlines())
    assert sum(map(int, counts.values())) == 100
    assert {"101", "102", "103", "181", "182", "183"} <= set(counts)


def signals(name: str) -> tuple[int, int, dict[str, tuple[int, int]]]:
    """Identifier, length, and start and width of each signal of a message in the DBC file."""
    dbc = (ROOT / "examples/bus/robot.dbc").read_text()
    block = next(block for block in dbc.split("BO_ ")[1:] if block.split()[1] == f"{name}:")
    found = re.findall(r"SG_ (\w+) : (\d+)\|(\d+)@1\+", block)
    return int(block.split()[0]), int(block.split()[2]), {key: (int(start), int(width)) for key, start, width in found}


def read(frame: Frame, name: str) -> dict[str, int]:
    can_id, size, fields = signals(name)
    assert (can_id, size) == (frame.can_id, min(size, len(frame.data)))
    value = int.from_bytes(frame.data, "little")
    return {key: value >> start & (1 << width) - 1 for key, (start, width) in fields.items()}


@pytest.mark.parametrize("beacon", [Beacon(2, 13232, 1460930678), Beacon(1, 1, 0xFFFFFFFF)])
def test_the_dbc_file_reads_beacons_as_the_link_does(beacon: Beacon) -> None:
    frame = beacon_frame(beacon, CanIds())
    assert read_beacon(frame, CanIds()) == beacon
    assert read(frame, "BEACON") == {
        "version": 1,
        "fd": beacon.flags & 1,
        "compression": beacon.flags >> 1,
        "epoch": beacon.epoch,
        "profile_hash": beacon.profile_hash,
    }


def test_the_dbc_file_knows_stop_and_segments() -> None:
    assert read(stop_frame(3, CanIds()), "STOP") == {"reason": 3}
    for node in (1, 2, 3):
        assert node <= NODES
        for base, name in ((CanIds().up, "UP"), (CanIds().down, "DOWN")):
            frame = Frame(base + node, b"\xc5abc")
            assert read(frame, f"{name}_{node}") == {"first": 1, "last": 1, "counter": 5}

"""`msbot bus load`: the forecast as a table and as JSON."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from msbot.cli.bus.bus_commands import command
from msbot.config import write_sample

TYPE = """
number = "LITE"
name = "Light"
[[port]]
name = "out"
direction = "publish"
type = "LightLevel"
rate_hz = 1000
[[port]]
name = "in"
direction = "subscribe"
type = "LightLevel"
[[port]]
name = "button"
direction = "publish"
type = "Pressed"
[[type]]
name = "LightLevel"
fields = { words = "text" }
[[type]]
name = "Pressed"
fields = { at = "uint32" }
"""
ROBOT = """
[robot]
name = "R"
version = "1"
serial_number = "2"
released = "3"
manufacturer = "4"
[[binding]]
topic = "light"
type = "LightLevel"
from = "L0.out"
to = ["L1.in"]
[[binding]]
topic = "stop me"
type = "Pressed"
from = "L0.button"
to = []
"""


def said(*arguments: str) -> str:
    result = CliRunner().invoke(command, ["load", *arguments])
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture
def sample(tmp_path: Path) -> str:
    write_sample(tmp_path / "robot.toml")
    return str(tmp_path / "robot.toml")


def busy_robot(folder: Path, parts: int = 2) -> tuple[str, ...]:
    (folder / "library").mkdir()
    (folder / "library" / "LITE.toml").write_text(TYPE)
    slots = "".join(f'[[slot]]\nname = "L{number}"\npart = "LITE"\n' for number in range(parts))
    (folder / "busy.toml").write_text(ROBOT.replace("[[binding]]", f"{slots}[[binding]]", 1))
    return (str(folder / "busy.toml"), "--library", str(folder / "library"))


def test_the_table_adds_up(sample: str) -> None:
    lines = said(sample).splitlines()
    assert lines[0] == "MSBOT_MASTER with 3 parts on classic CAN at 500 kbit/s, with header compression"
    rows = {line.split()[0]: [float(cell.rstrip("%")) for cell in line.split()[1:]] for line in lines[3:9]}
    assert list(rows) == [
        "BEACON",
        "beats",
        *(f"HelloWorldTopic_{way}" for way in ("1_to_2", "2_to_3", "3_to_1")),
        "together",
    ]
    for column in range(4):
        parts = sum(row[column] for name, row in rows.items() if name != "together")
        assert parts == pytest.approx(rows["together"][column], abs=3 if column == 2 else 0.3)
    assert rows["beats"][0] == 6
    assert rows["together"][2] / 500_000 * 100 == pytest.approx(rows["together"][3], abs=0.01)
    assert lines[-2].startswith("Without header compression: 1.7")
    assert lines[-1].startswith("At other bit rates: 125 kbit/s 4.")


def test_json_has_every_flow_and_both_loads(sample: str) -> None:
    found = json.loads(said(sample, "--json"))
    assert (found["robot"], found["parts"], found["bitrate"], found["data_bitrate"]) == (
        "MSBOT_MASTER",
        3,
        500_000,
        None,
    )
    assert found["compression"] is True
    assert found["load_percent"] == found["load_percent_with_compression"] < found["load_percent_without_compression"]
    bits = sum(flow["messages_per_s"] * (flow["nominal_bits"] + flow["data_bits"]) for flow in found["flows"])
    assert bits / 5000 == pytest.approx(found["load_percent"], abs=0.001)
    assert (found["assumed_bytes"], found["not_counted"]) == ({}, [])
    without = json.loads(said(sample, "--json", "--no-compression"))
    assert without["load_percent"] == found["load_percent_without_compression"]


def test_bit_rates_and_fd(sample: str) -> None:
    half = json.loads(said(sample, "--json", "--bitrate", "250000"))["load_percent"]
    assert half == pytest.approx(2 * json.loads(said(sample, "--json"))["load_percent"], rel=0.001)
    fast = json.loads(said(sample, "--json", "--fd", "--data-bitrate", "5000000"))
    assert fast["data_bitrate"] == 5_000_000
    assert fast["load_percent"] < 0.5
    table = said(sample, "--fd")
    assert "on CAN FD at 500 kbit/s and 2000 kbit/s" in table
    assert "At other bit rates" not in table


def test_what_was_assumed_and_left_out_is_said(tmp_path: Path) -> None:
    arguments = busy_robot(tmp_path)
    text = said(*arguments)
    assert "Samples of LightLevel are taken for 8 bytes; say --size LightLevel=BYTES if they are not." in text
    assert "Not counted, because their port has no rate_hz: stop me." in text
    assert "That leaves too little room" not in text
    text = said(*arguments, "--size", "LightLevel=4", "--size", "Pressed=1")
    assert "are taken for" not in text


def test_a_bus_that_is_too_slow_is_named(tmp_path: Path) -> None:
    arguments = busy_robot(tmp_path, parts=121)
    at_1m = json.loads(said(*arguments, "--bitrate", "1000000", "--json"))["load_percent"]
    text = said(*arguments, "--bitrate", str(int(1e4 * at_1m / 1.1)))
    assert "That does not fit the bus." in text
    assert "A bus has addresses for 120 parts." in text
    assert "That leaves too little room" in said(*arguments, "--bitrate", str(int(1e4 * at_1m / 0.9)))


@pytest.mark.parametrize("size", ["LightLevel", "=4", "LightLevel=", "LightLevel=x", "LightLevel=-1", "A=99999"])
def test_sizes_that_make_no_sense(size: str, sample: str) -> None:
    result = CliRunner().invoke(command, ["load", sample, "--size", size])
    assert result.exit_code == 2
    assert "write TYPE=BYTES, for example LightLevel=12" in result.output

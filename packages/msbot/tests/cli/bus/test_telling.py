"""`msbot bus dump` and `decode` with a robot: sentences first, the words of the protocol when they are asked for."""

from __future__ import annotations

import asyncio
import json
import re
from pathlib import Path
from random import Random

import click
import pytest

from msbot.config import SAMPLES, load_library, parse_blueprint
from msbot.process.virtual_time import run_virtual
from msbot.registry import open_registry
from msbot_agent.link.can.protocol import Frame, LogLine, format_log_line
from msbot_school.demo import DemoLinkKind, DemoRobot
from msbot_xrce.errors import ConfigError
from tests.cli.live_bus import invoke

SENTENCE = re.compile(r"  knob says level \d+(\.\d+)? %$")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What is on the rover's bus while its knob and its fan join and work."""
    lines: list[str] = []

    def tap(at: float, _sender: str, frame: Frame) -> None:
        lines.append(format_log_line(LogLine(1000.0 + at, "can0", frame)))

    async def main() -> None:
        library = load_library()
        with open_registry(tmp_path_factory.mktemp("rover") / "robot.db") as registry:
            blueprint = parse_blueprint(SAMPLES["rover"], library)
            store = registry.runs.begin(registry.robots.apply_blueprint(blueprint, library))
            robot = DemoRobot(
                blueprint, store, wire=DemoLinkKind.CAN, names=("knob", "fan"), random=Random(1), epoch_ns=lambda: 0
            )
            robot.on_frame(tap)
            async with asyncio.TaskGroup() as tasks:
                running = tasks.create_task(robot.run())
                await robot.master.ready.wait()
                await asyncio.sleep(6.0)
                robot.finish()
                await running

    run_virtual(main())
    return "\n".join(lines) + "\n"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder without a robot."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def blueprint(folder: Path) -> Path:
    """The robot.toml in that folder."""
    path = folder / "robot.toml"
    path.write_text(SAMPLES["rover"])
    return path


@pytest.mark.parametrize("verb", ["decode", "dump"])
def test_with_a_robot_here_each_frame_is_one_line_and_what_a_part_says_a_sentence(
    verb: str, log: str, blueprint: Path
) -> None:
    lines = invoke(verb, "-", text=log).stdout.splitlines()
    assert len(lines) == len(log.splitlines())
    assert any(SENTENCE.search(line) for line in lines)
    assert any("  fan hears " in line and line.endswith(" %") for line in lines)
    assert not any("WRITE_DATA" in line for line in lines)
    for words in (
        "a part asks for an address",
        "the master makes a part node 1",
        "the master says that it is there",
        "node 1 shows its part number, ",
        "the master tells fan what it does in this robot",
        "knob says that it is alive",
        "the master has heard that fan is alive",
        "fan has received everything",
        "node 2 sets up what it says and hears",
        "a piece of what node 1 sends",
    ):
        assert any(words in line for line in lines), words
    assert not any("session 0x" in line for line in lines)


@pytest.mark.parametrize("verb", ["decode", "dump"])
def test_the_words_of_the_protocol_stand_below_the_sentence_on_demand(verb: str, log: str, blueprint: Path) -> None:
    lines = invoke(verb, "-", "--protocol", text=log).stdout.splitlines()
    at = next(index for index, line in enumerate(lines) if SENTENCE.search(line))
    assert "#" not in lines[at]
    assert re.search(r"node \d to master, ", lines[at + 1])
    below = "\n".join(lines[at + 1 : at + 5])
    assert "WRITE_DATA to datawriter" in below
    assert re.search(r": Level\(percent=\d", below)


def test_without_a_robot_the_words_are_those_of_the_protocol(log: str, folder: Path) -> None:
    plain = invoke("decode", text=log).stdout
    assert "says level" not in plain
    assert "WRITE_DATA to datawriter" in plain
    assert invoke("decode", "--protocol", text=log).stdout == plain
    assert click.unstyle(invoke("dump", "-", text=log).stdout).split() == plain.split()


def test_a_robot_that_is_elsewhere_is_named(log: str, blueprint: Path) -> None:
    elsewhere = blueprint.rename("rover.toml")
    assert "says level" not in invoke("decode", text=log).stdout
    assert "knob says level" in invoke("decode", "--blueprint", str(elsewhere), text=log).stdout


@pytest.mark.parametrize("verb", ["decode", "dump"])
def test_json_carries_both(verb: str, log: str, blueprint: Path) -> None:
    rows = [json.loads(line) for line in invoke(verb, "-", "--json", text=log).stdout.splitlines()]
    assert len(rows) == len(log.splitlines())
    assert all(bool(row["plain"]) != bool(row["about"]) for row in rows), "one or the other"
    assert all(set(row) == {"at_s", "channel", "frame", "plain", "about", "protocol"} for row in rows)
    (row, *_) = [row for row in rows if any("knob says level" in sentence for sentence in row["plain"])]
    assert any("WRITE_DATA" in line for line in row["protocol"])
    assert f"({row['at_s']:017.6f}) {row['channel']} {row['frame']}" in log


def test_json_without_words(log: str) -> None:
    (line,) = invoke("dump", "-", "--json", "--no-decode", "--count", "1", text=log).stdout.splitlines()
    assert (json.loads(line)["plain"], json.loads(line)["protocol"]) == ([], [])


def test_a_robot_toml_that_is_wrong_is_told_and_the_bus_is_shown_all_the_same(log: str, blueprint: Path) -> None:
    blueprint.write_text("[robot\n")
    result = invoke("decode", text=log)
    assert result.stderr.startswith("msbot: no sentences, because the robot.toml here cannot be used: robot.toml")
    assert "WRITE_DATA to datawriter" in result.stdout
    with pytest.raises(ConfigError, match=r"robot\.toml"):
        invoke("decode", "--blueprint", str(blueprint), text=log)


@pytest.mark.parametrize("verb", ["decode", "dump"])
def test_a_log_that_begins_late_says_how_many_samples_have_no_sentence(verb: str, log: str, blueprint: Path) -> None:
    lines = log.splitlines()
    late = invoke(verb, "-", text="\n".join(lines[len(lines) // 2 :]) + "\n")
    assert " says level" not in late.stdout
    assert "node 1 says something on a topic that is not known here" in late.stdout
    assert re.search(
        r"^msbot: \d+ samples have no sentence: their parts had joined before the log begins$", late.stderr
    )
    assert not invoke(verb, "-", text=log).stderr

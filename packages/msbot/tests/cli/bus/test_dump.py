"""`msbot bus dump`: live buses and logs, in words, filtered, written again."""

from __future__ import annotations

import importlib.util
import time
from pathlib import Path

import click
import pytest

from msbot.cli.bus.bus_source import open_bus
from msbot.cli.bus.dump import COLOURS, Dump, DumpOptions, Understanding, colour_of
from msbot.cli.bus.frame_log import FrameReader
from msbot.pnp import FrameListener
from msbot_agent.link.can.protocol.notation import LogLine, parse_frame
from msbot_agent.link.can.sim.python_can_interface import MsbotBus
from msbot_agent.link.can.sim.sim_bus_client import SimAdapter
from msbot_xrce.errors import ConfigError, LinkDown
from tests.cli.live_bus import bus, invoke, runtime_folder, talking

__all__ = ["bus", "runtime_folder", "talking"]

LOG = "(1700000000.0) can0 103#C181010700\n(1700000000.1) can0 7FF#11\n(1700000000.2) can0 104#C181010700\n"


def test_a_live_bus_in_words(talking: MsbotBus) -> None:
    lines = invoke("dump", "sim:bench1", "--count", "1").stdout.splitlines()
    assert len(lines) == 2
    assert lines[0].endswith("bench1       103   [5]  C1 81 01 07 00        node 3 to master, SE  1: 4 bytes")
    assert lines[1].strip() == "session 0x81, best-effort stream 0x01, message 7"
    at = float(lines[0].split("(")[1].split(")")[0])
    assert at == pytest.approx(time.time(), abs=60), "seconds since 1970"


def test_a_live_bus_without_words_and_a_log_of_it(talking: MsbotBus, tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    result = invoke("dump", "sim:bench1", "--no-decode", "--count", "3", "--log", str(path))
    assert [line.split(")")[1].strip() for line in result.stdout.splitlines()] == [
        "bench1       103   [5]  C1 81 01 07 00"
    ] * 3
    assert [line.frame for line in FrameReader().read(str(path))] == [parse_frame("103#C181010700")] * 3


def test_dumping_does_not_acknowledge() -> None:
    adapter = open_bus("sim:bench1", node="dump", listen_only=True)._adapter
    assert isinstance(adapter, SimAdapter)
    assert adapter._listen_only, "which is silent: test_sim_client"


def test_a_log_is_shown_like_a_bus(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_text(LOG)
    shown = invoke("dump", str(path)).stdout
    assert shown == invoke("decode", str(path)).stdout.replace(" \n", "\n")
    assert invoke("dump", "-", text=LOG).stdout == shown


def test_filters_and_count(tmp_path: Path) -> None:
    shown = invoke("dump", "-", "--filter", "node=4", "--filter", "7FF", "--no-decode", text=LOG).stdout.splitlines()
    assert [line.split()[2] for line in shown] == ["7FF", "104"]
    assert len(invoke("dump", "-", "--count", "1", "--no-decode", text=LOG).stdout.splitlines()) == 1


def test_lines_that_are_no_frames_are_told_at_the_end() -> None:
    result = invoke("dump", "-", text=LOG + "what?\n")
    assert "1 of 4 lines were no frames; line 4" in result.stderr


@pytest.mark.parametrize("ending", [".asc", ".blf", ".trc", ".csv", ".db", ".log"])
def test_every_format_is_written_and_read(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"bus{ending}"
    invoke("dump", "-", "--log", str(path), text=LOG)
    again = list(FrameReader().read(str(path)))
    assert [line.frame for line in again] == [parse_frame(line.split()[2]) for line in LOG.splitlines()]
    times = [line.at or 0.0 for line in again]
    assert [round(at - times[0], 3) for at in times] == [0, 0.1, 0.2]


def test_what_python_can_prints_is_written(tmp_path: Path) -> None:
    path = tmp_path / "bus.txt"
    invoke("dump", "-", "--log", str(path), text=LOG)
    assert [line.split()[3] for line in path.read_text().splitlines()] == ["103", "7ff", "104"]


@pytest.mark.skipif(importlib.util.find_spec("asammdf") is not None, reason="asammdf is there")
def test_mf4_needs_another_library(tmp_path: Path) -> None:
    path = tmp_path / "bus.mf4"
    with pytest.raises(ConfigError, match=r"writing .mf4 files needs asammdf: install it with"):
        invoke("dump", "-", "--log", str(path), text=LOG)
    assert not path.exists()
    path.write_bytes(b"MDF")
    with pytest.raises(ConfigError, match=r"reading .mf4 files needs asammdf"):
        invoke("dump", str(path))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["dump", "sim:nobody"], "there is no simulated bus 'nobody': start one with `msbot bus serve nobody`"),
        (["dump", "missing.log"], "cannot read missing.log: No such file"),
        (["dump", "missing.blf"], "cannot read missing.blf: No such file"),
        (["dump", "missing.db"], "cannot read missing.db: No such file"),
        (["dump", "bus.pcap"], "'bus.pcap' is neither a CAN bus nor a log that is there"),
        (["dump", "udp:127.0.0.1:8888"], "is neither a CAN bus nor a log"),
        (["dump", "no_can9"], "there is no interface no_can9"),
        (["dump", "-", "--log", "bus.xyz"], "its ending names no format; there are .log, .asc"),
        (["dump", "-", "--log", "missing/bus.log"], "cannot write missing/bus.log: No such file"),
        (["dump", "-", "--log", "missing/bus.asc"], "cannot write missing/bus.asc: No such file"),
    ],
)
def test_what_is_wrong_is_said(
    arguments: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises((ConfigError, LinkDown)) as raised:
        invoke(*arguments, text=LOG)
    assert words in str(raised.value)
    assert not (tmp_path / "missing.db").exists()


def test_each_node_has_its_colour() -> None:
    up, down, other = (colour_of(parse_frame(text)) for text in ("103#", "183#", "104#"))
    assert up == down == COLOURS[3] != other
    assert colour_of(parse_frame("008#01")) == colour_of(parse_frame("20000004#0008000000000000")) == "red"
    assert colour_of(parse_frame("7FF#")) is colour_of(parse_frame("00000103#")) is None
    lines: list[str] = []
    dumping = Dump(DumpOptions(), lines.append)
    dumping.begin(Understanding(FrameListener()))
    dumping.show(LogLine(1.0, "can0", parse_frame("103#C181010700")))
    assert lines[0].startswith("\x1b[")
    assert click.unstyle(lines[0]).startswith(" (0000000001.000000)  can0")

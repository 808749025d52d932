"""`msbot bus load` on a live bus."""

from __future__ import annotations

import json

import pytest

from msbot.cli.bus import load_measured as bus_live
from msbot.cli.bus.load_measured import MOST_ROWS, Second, who_says
from msbot.errors import ConfigError, LinkDown
from msbot.link.can.protocol import CanIds, frame_bits
from msbot.link.can.protocol.notation import parse_frame
from msbot.link.can.sim.python_can_interface import MsbotBus
from tests.cli.live_bus import bus, invoke, runtime_folder, talking

__all__ = ["bus", "runtime_folder", "talking"]


@pytest.fixture(autouse=True)
def short_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bus_live, "WINDOW_S", 0.2)


def test_bits_are_counted_by_identifier() -> None:
    second = Second()
    texts = ["103#C181010700"] * 3 + ["7FF#", "0ABCDEF0#0011223344556677", "20000004#00"]
    for text in texts:
        second.add(parse_frame(text), 500_000, None)
    bits = sum(frame_bits(parse_frame("103#C181010700")))
    traffic = second.by_id["103"]
    assert (traffic.who, traffic.frames, traffic.bits) == ("node 3 to master", 3, 3 * bits)
    assert traffic.busy_s == pytest.approx(3 * bits / 500_000)
    assert second.uncounted == 1
    assert second.total().frames == 5
    assert [digits for digits, _ in second.rows()] == ["103", "0ABCDEF0", "7FF"]


def test_many_identifiers_are_added_up() -> None:
    second = Second()
    for can_id in range(MOST_ROWS + 4):
        second.add(parse_frame(f"{can_id:03X}#"), 500_000, None)
    rows = second.rows()
    assert len(rows) == MOST_ROWS + 1
    assert (rows[-1][1].who, rows[-1][1].frames) == ("4 more", 4)


def test_a_data_phase_is_counted_at_its_rate() -> None:
    second = Second()
    second.add(parse_frame("123##1" + "55" * 64), 500_000, 2_000_000)
    length = frame_bits(parse_frame("123##1" + "55" * 64))
    assert second.total().busy_s == pytest.approx(length.nominal_bits / 500_000 + length.data_bits / 2_000_000)


def test_a_live_bus_second_by_second(talking: MsbotBus) -> None:
    lines = invoke("load", "sim:bench1", "--seconds", "2").stdout.splitlines()
    assert len(lines) == 4
    assert lines[0].split()[:4] == ["0", "s", "load", lines[0].split()[3]]
    assert "of 500 kbit/s" in lines[0]
    assert "103  node 3 to master" in lines[1]


def test_a_live_bus_as_json(talking: MsbotBus) -> None:
    (line,) = invoke("load", "sim:bench1", "--seconds", "1", "--json").stdout.splitlines()
    answer = json.loads(line)
    traffic = answer["by_id"]["103"]
    assert (answer["bitrate"], traffic["who"]) == (500_000, "node 3 to master")
    assert traffic["frames"] == answer["frames"] > 0
    assert answer["load_percent"] == pytest.approx(100 * answer["bits"] / 500_000 / 0.2, abs=1e-3)


def test_who_says() -> None:
    joining = f"{CanIds().join + 1:08X}#", f"{CanIds().assign + 1:08X}#"
    texts = ("103#", "183#", "700#", "008#01", *joining, "7FF#", "100#", "00000103#")
    assert [who_says(parse_frame(text)) for text in texts] == [
        "node 3 to master",
        "master to node 3",
        "BEACON",
        "STOP",
        "joining",
        "joining",
        "foreign",
        "foreign",
        "foreign",
    ]


def test_what_is_wrong_is_said() -> None:
    with pytest.raises(LinkDown, match="there is no simulated bus 'bench1'"):
        invoke("load", "sim:bench1")
    with pytest.raises(ConfigError, match=r"missing\.toml"):
        invoke("load", "missing.toml")

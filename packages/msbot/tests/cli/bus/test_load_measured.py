"""`msbot bus load` on a live bus."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable

import pytest

from msbot.cli.bus import load as bus_live
from msbot.cli.bus.load import MOST_ROWS, Second, show_load, who_says
from msbot_agent.link.can.protocol import CanIds, frame_bits
from msbot_agent.link.can.protocol.notation import parse_frame
from msbot_agent.link.can.sim.python_can_interface import MsbotBus
from msbot_xrce.errors import ConfigError, LinkDown
from tests.cli.live_bus import bus, invoke, runtime_folder, talking

__all__ = ["bus", "runtime_folder", "talking"]


def patiently(look: Callable[[float], None], monkeypatch: pytest.MonkeyPatch) -> None:
    """With short seconds, and with longer ones if this computer was too busy for those: a thread may stand still."""
    for window in (0.2, 2.0, 20.0):
        monkeypatch.setattr(bus_live, "WINDOW_S", window)
        try:
            look(window)
        except AssertionError:
            if window == 20.0:
                raise
        else:
            return


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


def test_a_live_bus_second_by_second(talking: MsbotBus, monkeypatch: pytest.MonkeyPatch) -> None:
    def look(window: float) -> None:
        lines = invoke("load", "sim:bench1", "--seconds", "2").stdout.splitlines()
        assert len(lines) == 4
        assert re.match(rf" +{window:.0f} s   load +\d+\.\d\d% of 500 kbit/s   \d+ frames?$", lines[0])
        assert "103  node 3 to master" in lines[1]
        assert "103  node 3 to master" in lines[3]

    patiently(look, monkeypatch)


def test_a_live_bus_as_json(talking: MsbotBus, monkeypatch: pytest.MonkeyPatch) -> None:
    def look(window: float) -> None:
        (line,) = invoke("load", "sim:bench1", "--seconds", "1", "--json").stdout.splitlines()
        answer = json.loads(line)
        assert list(answer["by_id"]) == ["103"]
        traffic = answer["by_id"]["103"]
        assert (answer["bitrate"], traffic["who"]) == (500_000, "node 3 to master")
        assert traffic["frames"] == answer["frames"] > 0
        assert window <= answer["length_s"] + 1e-6
        assert answer["at_s"] == pytest.approx(answer["length_s"], abs=1e-3)
        load = 100 * answer["bits"] / 500_000 / answer["length_s"]
        assert answer["load_percent"] == traffic["load_percent"] == pytest.approx(load, abs=1e-3)

    patiently(look, monkeypatch)


def test_seconds_in_which_the_program_stood_still_are_not_told_by_themselves(
    talking: MsbotBus, monkeypatch: pytest.MonkeyPatch
) -> None:
    def look(window: float) -> None:
        answers = []

        def say(line: str) -> None:
            answers.append(json.loads(line))
            if len(answers) == 1:
                time.sleep(2.5 * window)

        show_load("sim:bench1", bitrate=1, data_bitrate=1, seconds=2, as_json=True, say=say, complain=lambda _: None)
        assert len(answers) == 2
        first, second = answers
        assert first["frames"] > 0
        assert second["frames"] > 0
        assert second["length_s"] == pytest.approx(second["at_s"] - first["at_s"], abs=0.002)
        assert second["length_s"] >= 3 * window - 1e-6
        load = 100 * second["bits"] / 500_000 / second["length_s"]
        assert second["load_percent"] == pytest.approx(load, abs=1e-3)

    patiently(look, monkeypatch)


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

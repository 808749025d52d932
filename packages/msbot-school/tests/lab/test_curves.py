"""Curves out of recordings: the values that were said, what was set, the load of the bus, and how long beats take."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from msbot.config import load_library
from msbot.operations.dispatch import InProcessOperations
from msbot.recording.curves.curve import WantedCurves, field_name, figures_of, is_wanted, thinned
from msbot.recording.curves.curve_reader import ReadCurves, read_curves, ring_files, units_of
from msbot.recording.recorder.batch import MEASURED, Kind, RecordedChannel, encode_object
from msbot.recording.recorder.recording_file import RingLimits, segment_name
from msbot.recording.recorder.ring_storage import Storing
from msbot_school.demo import DemoRobot
from msbot_xrce.errors import ConfigError
from tests.lab.recorded import BEGAN_NS, NS, messages, record_demo, store

BEGAN_S = BEGAN_NS / NS
BITRATE = 500_000
THRESHOLD = "ear:threshold"


async def a_setting_is_changed(robot: DemoRobot, operations: InProcessOperations) -> None:
    await asyncio.sleep(4)
    await operations.do("set", slot="ear", name="threshold", value=40, who="ada")
    await asyncio.sleep(4)
    assert robot.bus_driver is not None
    LOADS.append(100 * robot.bus_driver.bus.counters.busy_s)


LOADS: list[float] = []


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recording")
    record_demo(folder, folder / "a.mcap", a_setting_is_changed, ("knob", "fan", "ear"), "rover")
    return folder / "a.mcap"


def read(path: Path, *wanted: str, **more: float) -> ReadCurves:
    return read_curves([path], wanted, unit_of=units_of(load_library()), **more)  # type: ignore[arg-type]  # only times


def values(found: ReadCurves, name: str) -> list[float]:
    (curve,) = [curve for curve in found.curves if curve.name == name]
    return [value for _, value in curve.points]


def test_a_port_s_values_are_those_that_were_said_at_their_times(recording: Path) -> None:
    said = [one for one in messages(recording) if one.slot == "knob" and not one.is_repeated]
    (curve,) = read(recording, "knob.level").curves
    assert (curve.name, curve.unit) == ("knob.level.percent", "%")
    assert [at for at, _ in curve.points] == [one.at_ns / NS for one in said]
    (heard,) = read(recording, "fan.power.percent").curves
    assert heard.points == curve.points, "the port that reads the topic has the same values"


def test_a_setting_is_a_step_where_it_was_changed(recording: Path) -> None:
    found = read(recording, "ear")
    (curve,) = [curve for curve in found.curves if curve.name == THRESHOLD]
    assert curve.unit == "%"
    steps = [value for _, value in curve.points]
    assert steps == [60, 60, 40, 40]
    at = [at - curve.points[0][0] for at, _ in curve.points]
    assert at[1] == pytest.approx(at[2], abs=1e-5)
    assert curve.points[-1][0] == pytest.approx(found.last_s)


def test_the_load_of_the_bus_is_that_of_its_frames_to_the_bit(recording: Path) -> None:
    found = read(recording, "@bus", "@frames")
    loads, frames = values(found, "@bus"), values(found, "@frames")
    assert len(loads) == len(frames) >= 6
    counts: dict[int, int] = {}
    for one in messages(recording):
        if one.topic.startswith("/msbot/frames/"):
            counts[one.at_ns // NS] = counts.get(one.at_ns // NS, 0) + 1
    assert frames == [counts[second] for second in sorted(counts)[1:-1]]
    assert all(50 * n / BITRATE * 100 < load < 135 * n / BITRATE * 100 for n, load in zip(frames, loads, strict=True))
    whole = read(recording, "@bus", from_s=BEGAN_S - 10).curves[0]
    assert sum(value for _, value in whole.points) < LOADS[0] + 1, "not more than the bus itself has counted"


def test_a_piece_has_only_its_time_and_a_setting_s_value_from_before(recording: Path) -> None:
    first_s = read(recording).first_s
    found = read(recording, "ear", from_s=first_s + 1, to_s=first_s + 2)
    for curve in found.curves:
        assert first_s + 1 <= curve.points[0][0] <= curve.points[-1][0] <= first_s + 2.001
    assert len(values(found, THRESHOLD)) == 2


def test_what_is_not_there_is_not_known_and_a_table_of_contents_costs_no_curve(recording: Path) -> None:
    assert read(recording, "ZZ").curves == ()
    known = read(recording)
    assert known.curves == ()
    assert {"@bus", "@frames", THRESHOLD} <= set(known.known)


def test_what_was_measured_is_read_back(tmp_path: Path) -> None:
    channel = RecordedChannel(MEASURED, "json")
    items = [(int(Kind.CHANNEL), 1, 0, channel.encode())]
    for second in range(3):
        value = {"late_ms": second / 10, "beats": {"AA": 1 + second / 100} if second else {}}
        value |= {"latency_ms": None if second == 1 else 0.5, "acks_ms": {"AA": 2.5} if second == 2 else {}}
        items.append((int(Kind.OBJECT), 1, BEGAN_NS + second * NS, encode_object(value)))
    items.append((int(Kind.OBJECT), 1, BEGAN_NS + 3 * NS, encode_object({"late_ms": None, "beats": 7, "acks_ms": []})))
    store(items, tmp_path / "a.mcap")
    found = read(tmp_path / "a.mcap", "@late", "@latency", "@beat", "@ack")
    assert values(found, "@late") == [0.0, 0.1, 0.2]
    assert values(found, "@beat.AA") == [1.01, 1.02]
    assert values(found, "@latency") == [0.5, 0.5], "a second in which none was measured has no value"
    assert values(found, "@ack.AA") == [2.5]
    units = {curve.name: curve.unit for curve in found.curves}
    assert units == {"@late": "ms", "@latency": "ms", "@beat.AA": "s", "@ack.AA": "ms"}
    assert found.figures["@late"].mean == pytest.approx(0.1)


def test_of_a_ring_only_the_files_of_the_time_are_read_and_nothing_twice(tmp_path: Path) -> None:
    storing = Storing(tmp_path / "ring", RingLimits(30.0, 10 << 20), lambda file, trouble: None)
    storing.take((Kind.CHANNEL, 1, 0, RecordedChannel(MEASURED, "json").encode()), 0.0)
    for second in range(20):
        value = encode_object({"late_ms": float(second), "beats": {}})
        storing.take((Kind.OBJECT, 1, BEGAN_NS + second * NS, value), float(second))
        storing.flush(float(second))
    storing.close()
    every = ring_files(tmp_path / "ring")
    some = ring_files(tmp_path / "ring", BEGAN_S + 10, BEGAN_S + 12)
    assert 0 < len(some) < len(every)
    found = read_curves(some, ["@late"], from_s=BEGAN_S + 10, to_s=BEGAN_S + 12)
    assert values(found, "@late") == [10.0, 11.0, 12.0]
    assert values(read_curves(every, ["@late"]), "@late") == [float(second) for second in range(20)]
    assert ring_files(tmp_path / "nowhere") == []
    (tmp_path / "begun").mkdir()
    assert ring_files(tmp_path / "begun") == []  # the recorder has made its folder, and no file yet
    (tmp_path / "begun" / segment_name(BEGAN_NS, 0)).touch()
    assert ring_files(tmp_path / "begun") == []  # nor anything in its file


def test_too_much_is_refused_in_words(recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("msbot.recording.curves.curve_reader.MOST_POINTS", 10)
    with pytest.raises(ConfigError, match="choose fewer curves, or a shorter time"):
        read(recording, "ear")


def test_names_are_the_same_whoever_writes_them() -> None:
    assert field_name("pose.wheelSpeed[0]") == field_name("pose.wheel_speed.0") == "pose.wheel_speed.0"
    assert is_wanted("a.b.c", ["a"])
    assert is_wanted("a:b", ["a"])
    assert not is_wanted("ab.c", ["a"])


@example([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0], 5)
@given(st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=300), st.integers(4, 50))
def test_a_thinned_curve_has_the_same_extremes_and_is_in_order(numbers: list[float], most: int) -> None:
    points = [(float(at), value) for at, value in enumerate(numbers)]
    kept = thinned(points, most)
    assert len(kept) <= max(most, 4)
    assert list(kept) == sorted(set(kept))
    assert set(kept) <= set(points)
    assert min(numbers) == min(value for _, value in kept)
    assert max(numbers) == max(value for _, value in kept)
    found = figures_of(numbers)
    assert found is not None
    assert found.least <= found.mean + 1e-6
    assert found.mean <= found.most + 1e-6


def test_figures_leave_out_what_is_no_number() -> None:
    found = figures_of([1.0, float("nan"), 3.0, float("inf")])
    assert found is not None
    assert (found.count, found.mean, found.least, found.most) == (2, 2.0, 1.0, 3.0)
    assert figures_of([float("nan")]) is None


def test_what_is_asked_for_before_it_is_measured_is_found_once_it_is() -> None:
    wanted = WantedCurves(["ear.level", "", "knob", "@bus"], most=4)
    assert wanted.found(["ear.level.percent", "ear.other"]) == ["ear.level.percent"]
    assert wanted.awaited == ["knob", "@bus"]
    shown = ["ear.level.percent"]
    assert wanted.found(["ear.level.percent", "ear.other", "earlier"], shown) == []
    assert wanted.awaited == ["knob", "@bus"]
    known = ["ear.level.percent", "knob.level.percent", "knob:step", "knobs", "@bus"]
    assert wanted.found(known, shown) == ["knob.level.percent", "knob:step", "@bus"]
    assert wanted.awaited == []
    assert wanted.found(known) == []
    assert WantedCurves(["knob"], most=2).found(known, shown) == ["knob.level.percent"]
    assert WantedCurves(["knob"], most=1).found(known, shown) == []

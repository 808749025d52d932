"""What can be drawn of a robot that runs, and what its recorder has of the past."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import pytest

from msbot.config import Library
from msbot.part import HelloWorld
from msbot.recording.curves.curve import FRAMES, LATE
from msbot.recording.recorder.batch import MEASURED, Kind, RecordedChannel, encode_object
from msbot.recording.recorder.recording_file import RingLimits
from msbot.recording.recorder.ring_storage import Storing
from msbot_web.recorded_past import MOST_POINTS, RecordedPast
from msbot_xrce.errors import ConfigError
from tests.lab.recorded import BEGAN_NS, NS
from tests.operations.stage import AA_IS_A_DIAL
from tests.web.rig import Rig, show


def test_ports_and_beats_are_curves_and_only_what_is_new_is_given(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        for index in range(20):
            rig.stage.parts["AA"].publish("out", HelloWorld(index=index, message="7"))
            await rig.look(0.25)
        curves = rig.views.curves
        known = curves.known()
        said, heard = "AA.out.index", "BB.in.index"
        assert {said, heard} <= set(known)
        assert "AA.out.message" not in known, "a text is no curve, whatever is in it"
        points = curves.points_after(said, 0.0)
        assert points == curves.points_after(heard, 0.0)
        assert [value for _, value in points] == list(range(20))
        assert curves.points_after(said, points[-2][0]) == points[-1:]
        assert curves.points_after(said, points[-1][0]) == []
        beats = curves.points_after("@beat.AA", 0.0)
        assert known["@beat.AA"].unit == "s"
        assert [seconds for _, seconds in beats[1:]] == pytest.approx([1.0] * len(beats[1:]), abs=0.1)
        assert known[LATE].unit == "ms"
        assert known["@latency"].unit == known["@ack.AA"].unit == "ms"
        assert all(0 <= ms < 1000 for name in ("@latency", "@ack.AA") for _, ms in curves.points_after(name, 0.0))
        assert FRAMES not in known, "this robot has no bus"
        assert curves.points_after("no.such.curve", 0.0) == []

    show(tmp_path, scene)


def test_a_setting_holds_until_it_is_changed(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        await rig.look(4)
        curves = rig.views.curves
        name = "AA:period_s"
        assert curves.known()[name].holds
        assert curves.known()[name].unit == "s"
        (first,) = curves.points_after(name, 0.0)
        await rig.stage.operations.do("set", slot="AA", name="period_s", value=0.5, who="ada")
        await rig.look(2)
        now = rig.service.now()
        assert [value for _, value in curves.points_after(name, 0.0)] == [first[1], 0.5]
        assert [value for _, value in curves.points_after(name, now)] == [0.5], "what holds is told, however old"

    show(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


def ring(folder: Path, seconds: int) -> None:
    storing = Storing(folder, RingLimits(3600.0, 100 << 20), lambda file, trouble: None)
    storing.take((Kind.CHANNEL, 1, 0, RecordedChannel(MEASURED, "json").encode()), 0.0)
    for number in range(seconds * 10):
        value = encode_object({"late_ms": float(number % 7), "beats": {}})
        storing.take((Kind.OBJECT, 1, BEGAN_NS + number * NS // 10, value), number / 10)
    storing.close()


async def test_the_past_is_read_by_another_process_thinned_and_with_figures_of_everything(tmp_path: Path) -> None:
    ring(tmp_path / "ring", 700)
    past = RecordedPast(lambda: str(tmp_path / "ring"), Library, tuple)
    began_s = BEGAN_NS / NS
    turns = 0

    async def turn() -> None:
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0.001)  # at its own turns only: the other process needs the processor

    turning = asyncio.get_running_loop().create_task(turn())
    read = await past.curves(["@late"], began_s + 100, began_s + 400)
    turning.cancel()
    assert turns > 20, "the event loop went on meanwhile"
    (curve,) = read.curves
    assert 100 < len(curve.points) <= MOST_POINTS
    assert read.figures["@late"].count == 3001
    assert read.figures["@late"].mean == pytest.approx(3.0, abs=0.01)
    assert json.dumps(curve.points)


async def test_what_is_not_recorded_is_said() -> None:
    with pytest.raises(ConfigError, match="--rec off"):
        await RecordedPast(str, Library, tuple).curves(["@late"], 0.0, 1.0)

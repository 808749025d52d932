"""A simulated part in a robot: what a person does to it, what the robot does to it."""

from __future__ import annotations

import asyncio
from pathlib import Path
from random import Random

import pytest

from msbot.config import PartType, Scalar, load_library
from msbot.part import JoinState
from msbot.part.join.pnp_messages import Setting
from msbot.part.messages.standard import Level
from msbot.process.virtual_time import run_virtual
from msbot.sim import make_simulator
from msbot_agent.link import Signal
from msbot_xrce.errors import ConfigError
from tests.sim.robot import LIBRARY, Bench, play


def test_an_unknown_number_is_told_with_the_nearest_one() -> None:
    with pytest.raises(ConfigError, match='the library has no part number "SG91"; did you mean "SG90"'):
        make_simulator("SG91", library=LIBRARY)


def test_a_part_may_show_its_version() -> None:
    assert make_simulator("SG90@2.1", library=LIBRARY).part.part_number == "SG90@2.1"


def test_names_and_uid_are_those_that_were_given() -> None:
    unit = make_simulator("SG90", uid=b"8 octets", local_name="left arm", random=Random(1))
    assert (unit.part.part_number, unit.part.local_name, unit.part.uid) == ("SG90", "left arm", b"8 octets")


WRONG: list[tuple[str, Scalar, str]] = [
    ("knbo", 5, "part POT-10K has no control 'knbo'; controls: knob"),
    ("knob", 101, "control knob is 101; it must be 0 to 100 %"),
    ("knob", True, "control knob must be a number, 0 to 100 %; it is the truth value true"),
]


@pytest.mark.parametrize(("name", "value", "sentence"), WRONG)
def test_what_cannot_be_done_is_explained(name: str, value: Scalar, sentence: str) -> None:
    unit = make_simulator("POT-10K", library=LIBRARY)
    with pytest.raises(ConfigError) as caught:
        unit.set(name, value)
    assert str(caught.value) == sentence


def test_a_part_without_controls_says_so() -> None:
    unit = make_simulator("LED", library=LIBRARY)
    assert unit.controls == ()
    with pytest.raises(ConfigError, match="part LED has no control 'x'; controls: it has none"):
        unit.value("x")


def test_it_can_be_played_with_before_any_loop_runs_and_no_time_passes_then() -> None:
    unit = make_simulator("LM393-SPEED", library=LIBRARY, random=Random(1))
    unit.set("wheel", 60)
    assert unit.value("wheel") == 60
    assert unit.readings()["pulses"] == 0

    async def later() -> Scalar:
        before = unit.readings()["pulses"]
        await asyncio.sleep(2)
        assert before == 0
        return unit.readings()["pulses"]

    assert run_virtual(later()) == pytest.approx(40, abs=1)  # 2 turns of 20 slots


def test_a_short_press_is_heard_as_two_messages() -> None:
    async def scene(bench: Bench) -> None:
        assert [bench.last("pressed")] == [{"on": False}]
        bench.unit.set("press", True)
        bench.unit.set("press", False)
        await asyncio.sleep(0.2)
        assert [getattr(message, "on", None) for message in bench.heard["pressed"]] == [False, True, False]

    play("BUTTON", scene)


def test_a_press_is_heard_within_a_tenth_of_a_second() -> None:
    async def scene(bench: Bench) -> None:
        bench.unit.set("press", True)
        await asyncio.sleep(0.1)
        assert bench.last("pressed") == {"on": True}

    play("BUTTON", scene)


def test_a_servo_goes_there_in_its_time_and_to_the_middle_on_stop() -> None:
    async def scene(bench: Bench) -> None:
        bench.send("angle", degrees=180.0)
        await asyncio.sleep(0.45)
        assert bench.unit.readings()["arm"] == pytest.approx(90 + 0.45 * 100, abs=8)
        await asyncio.sleep(2)
        assert bench.unit.readings()["arm"] == 170
        bench.unit.part._runner._signal_received(Signal.STOP, None, "test", 0.0)
        await asyncio.sleep(2)
        assert bench.unit.readings()["arm"] == 90
        assert bench.unit.part.state is JoinState.ACTIVE

    play("SG90", scene, {"speed": 100.0, "max_angle": 170.0})


def test_the_safe_value_of_its_slot_goes_before_the_librarys_also_without_a_master() -> None:
    async def scene(bench: Bench) -> None:
        bench.send("angle", degrees=170.0)
        await asyncio.sleep(3)
        bench.unit.part._runner._signal_received(Signal.STOP, None, "test", 0.0)
        await asyncio.sleep(3)
        assert bench.unit.readings()["arm"] == 45
        bench.end_master()
        await asyncio.sleep(20)
        assert bench.unit.readings()["arm"] == 45

    play("SG90", scene, {"angle.safe.degrees": 45.0})


def test_settings_that_change_hold_at_once_and_nonsense_changes_nothing() -> None:
    async def scene(bench: Bench) -> None:
        settings = bench.unit.part._runner.settings
        assert bench.unit.readings()["metres"] == pytest.approx(1.0, abs=0.02)
        settings.take([Setting(name="offset_m", value="0.5"), Setting(name="period_s", value="1.0")])
        assert bench.unit.readings()["metres"] == pytest.approx(1.5, abs=0.02)
        heard = len(bench.heard["distance"])
        await asyncio.sleep(10)
        assert len(bench.heard["distance"]) - heard == pytest.approx(10, abs=1)
        settings.take([Setting(name="offset_m", value="far"), Setting(name="period_s", value="-1")])
        assert bench.unit.readings()["metres"] == pytest.approx(1.0, abs=0.02)

    play("HC-SR04", scene)


def test_it_goes_on_when_the_master_is_gone_for_a_while() -> None:
    async def scene(bench: Bench) -> None:
        bench.send("left", percent=80.0)
        await asyncio.sleep(1)
        assert bench.unit.readings()["left_motor"] == 80
        bench.end_master()
        await asyncio.sleep(20)
        assert bench.unit.readings() == {"left_motor": 0, "right_motor": 0}

    play("L298N", scene)


def test_a_port_that_the_robot_does_not_use_stays_silent() -> None:
    dht = LIBRARY.get("DHT22")
    assert dht is not None

    async def scene(bench: Bench) -> None:
        bench.unit.part.bound = lambda port: port == "humidity"  # type: ignore[method-assign]  # as if not bound
        heard = {port: len(messages) for port, messages in bench.heard.items()}
        await asyncio.sleep(10)
        assert len(bench.heard["temperature"]) == heard["temperature"]
        assert len(bench.heard["humidity"]) == heard["humidity"] + 5
        assert bench.unit.part.counters.handler_errors == 0

    play(dht, scene)


def test_a_type_of_ones_own_with_a_message_of_its_own_works_without_code(tmp_path: Path) -> None:
    (tmp_path / "vane.toml").write_text(
        'number = "VANE"\nname = "Wind vane"\n'
        '[[type]]\nname = "Wind"\nfields = { speed = "float32", from = "uint16" }\n'
        '[[port]]\nname = "wind"\ndirection = "publish"\ntype = "Wind"\nrate_hz = 5\n'
        '[[port]]\nname = "brake"\ndirection = "subscribe"\ntype = "Switch"\nsafe = { on = true }\n'
    )
    vane: PartType | None = load_library(tmp_path).get("VANE")
    assert vane is not None

    async def scene(bench: Bench) -> None:
        bench.unit.set("wind_speed", 7.5)
        bench.unit.set("wind_from", 270)
        await asyncio.sleep(1)
        assert bench.last("wind") == {"speed": 7.5, "from": 270}
        assert bench.unit.readings() == {"brake": True}
        bench.send("brake", on=False)
        await asyncio.sleep(0.1)
        assert bench.unit.readings() == {"brake": False}

    play(vane, scene)


def test_only_the_port_whose_partner_is_lost_becomes_safe() -> None:
    async def scene(bench: Bench) -> None:
        for port in ("left", "right"):
            bench.send(port, percent=80.0)
        await asyncio.sleep(1)
        left = bench.part_type.port("left")
        assert left is not None
        bench.unit.part._runner.safety._messages["left"] = Level(percent=0.0)
        bench.unit.part._runner.safety.enter("left")
        await asyncio.sleep(1)
        assert bench.unit.readings() == {"left_motor": 0, "right_motor": 80}

    play("L298N", scene)


def test_a_person_may_say_how_often_something_is_said_and_fixed_values_go_out(tmp_path: Path) -> None:
    (tmp_path / "metronome.toml").write_text(
        'number = "TICK"\nname = "Metronome"\n'
        '[[port]]\nname = "beat"\ndirection = "publish"\ntype = "Tone"\n'
        '[[simulator.control]]\nname = "pace"\ntype = "number"\nstart = 1\nmin = 0.1\nmax = 2\n'
        '[[simulator.publish]]\nport = "beat"\nevery = "pace"\nfields = { hertz = 880, seconds = 0.1 }\n'
    )
    metronome = load_library(tmp_path).get("TICK")
    assert metronome is not None

    async def scene(bench: Bench) -> None:
        bench.unit.set("pace", 0.5)
        heard = len(bench.heard["beat"])
        await asyncio.sleep(10)
        assert len(bench.heard["beat"]) - heard == pytest.approx(20, abs=1)
        assert bench.last("beat") == {"hertz": 880.0, "seconds": pytest.approx(0.1)}

    play(metronome, scene)


def test_a_seeded_part_says_the_same_every_time() -> None:
    async def scene(bench: Bench) -> None:
        await asyncio.sleep(5)

    first, second = (play("HC-SR04", scene).heard for _ in range(2))
    assert first == second

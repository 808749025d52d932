"""A robot at a genuine broker, as Home Assistant sees it: declared, with its values; commands are gated, STOP holds."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest

from msbot.config import load_library
from msbot_bridges.mqtt.ha_components import shown_fields, state_text
from tests.bridges.mosquitto import kept, mosquitto, publish, wait_until_kept, wait_until_near
from tests.e2e.processes import run, running
from tests.e2e.test_processes import free_port

pytest.importorskip("aiomqtt")
ROBOT = """
[robot]
name = "CART"
[timing]
preset = "thesis"
[[slot]]
name = "knob"
part = "POT-10K"
[[slot]]
name = "motors"
part = "L298N"
[[binding]]
topic = "power"
type = "Level"
from = "knob.level"
to = ["motors.left"]
"""
LEFT = "msbot/CART/motors/left/percent"


def test_home_assistant_sees_the_robot_and_drives_it_within_its_rules(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(ROBOT)
    link = ("--link", f"udp:127.0.0.1:{free_port()}")
    state = {"XDG_STATE_HOME": str(tmp_path / "state")}
    with (
        mosquitto(tmp_path) as port,
        running("master", "--no-page", "--home-assistant", f"mqtt://127.0.0.1:{port}", *link, cwd=tmp_path) as master,
        running("part", "L298N", *link, cwd=tmp_path, env=state) as motors,
    ):
        master.wait_for("is up on")
        motors.wait_for("active: in slot motors")
        with running("part", "POT-10K", "--set", "knob=80.5", *link, cwd=tmp_path, env=state) as knob:
            motors.wait_for("left_motor 80")  # a knob has noise
            declared = json.loads(kept(port, "homeassistant/number/msbot_CART_motors_left_percent/config"))
            assert declared["state_topic"] == LEFT
            assert (declared["min"], declared["max"]) == (-100, 100)
            assert declared["device"]["name"] == "CART motors"
            assert [one["topic"] for one in declared["availability"]] == [
                "msbot/CART/status",
                "msbot/CART/motors/status",
            ]
            wait_until_kept(port, "msbot/CART/status", "online")
            wait_until_kept(port, "msbot/CART/knob/status", "online")
            wait_until_near(port, "msbot/CART/knob/level/percent", 80.5)
            wait_until_near(port, LEFT, 80.5)

            publish(port, f"{LEFT}/set", "20")
            motors.wait_for("left_motor 20 %")
            wait_until_kept(port, LEFT, "20")
            publish(port, f"{LEFT}/set", "2000")
            master.wait_for("Home Assistant", "must be from -100 to 100 %")
            publish(port, "msbot/CART/stop/set", "PRESS")
            motors.wait_for("left_motor 0 %")
            wait_until_kept(port, "msbot/CART/stopped", "ON")
            wait_until_kept(port, LEFT, "0")
            publish(port, f"{LEFT}/set", "50")
            master.wait_for("Home Assistant", "STOP is in force")
            assert run("go", cwd=tmp_path).returncode == 0
            motors.wait_for("left_motor 80")

            publish(port, f"{LEFT}/set", "30")
            motors.wait_for("left_motor 30 %")
            publish(port, "homeassistant/status", "offline")
            motors.wait_for("left_motor 80")  # nobody sees it any more: the wire again
            knob.end(signal.SIGKILL)
        wait_until_kept(port, "msbot/CART/knob/status", "offline")
        master.end(signal.SIGKILL)
        wait_until_kept(port, "msbot/CART/status", "offline")


def test_each_value_of_the_library_has_a_component() -> None:
    library = load_library()
    for number in ("SG90", "TOGGLE", "INA219", "LED", "LCD1602", "HELLO" if library.find("HELLO") else "L298N"):
        part_type = library.find(number)
        assert part_type is not None
        ports = frozenset(port.name for port in part_type.ports)
        shown = shown_fields("R 2/x", "slot+1", part_type, ports)
        assert shown, number
        for one in shown:
            assert set(one.topic) & set("+# ") == set()
            assert one.topic.startswith("msbot/R_2_x/slot_1/")


@pytest.mark.parametrize(
    ("value", "text"), [(True, "ON"), (3, "3"), (0.1, "0.1"), (float("nan"), None), ("x" * 999, "x" * 255)]
)
def test_a_state_is_what_home_assistant_takes(value: object, text: str | None) -> None:
    assert state_text(value) == text

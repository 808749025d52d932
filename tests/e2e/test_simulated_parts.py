"""Simulated parts of the library in processes of their own: a knob drives a motor, and a like part takes its place."""

from __future__ import annotations

import signal
from pathlib import Path

from tests.e2e.processes import run, running
from tests.e2e.test_processes import free_port

ROBOT = """
[robot]
name = "CART"
version = "1"
serial_number = "2"
released = "3"
manufacturer = "4"
[timing]
preset = "fast"
[[slot]]
name = "knob"
part = "POT-10K"
[[slot]]
name = "motors"
part = "L298N"
[slot.settings]
most = 60.0
[[binding]]
topic = "power"
type = "Level"
from = "knob.level"
to = ["motors.left"]
"""


def test_a_knob_drives_a_motor_as_it_is_set_until_stop_and_until_it_is_gone(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text(ROBOT)
    link = ("--link", f"udp:127.0.0.1:{free_port()}")
    state = {"XDG_STATE_HOME": str(tmp_path / "state")}
    with (
        running("master", "--no-page", *link, cwd=tmp_path) as master,
        running("part", "TB6612FNG", *link, cwd=tmp_path, env=state) as motors,
    ):
        master.wait_for("is up on")
        motors.wait_for("active: in slot motors")  # of another type, which the library says will do
        with running("part", "POT-10K", "--set", "knob=80", *link, cwd=tmp_path, env=state) as knob:
            knob.wait_for("active: in slot knob")
            motors.wait_for("left_motor 60 %")  # the slot's setting, not the knob's 80
            assert run("set", "motors", "most", "30", cwd=tmp_path).returncode == 0
            motors.wait_for("left_motor 30 %")
            assert run("stop", cwd=tmp_path).returncode == 0
            motors.wait_for("left_motor 0 %")
            master.wait_for("STOP by ", ", from a terminal of the robot's computer")
            assert run("go", cwd=tmp_path).returncode == 0
            motors.wait_for("left_motor 30 %")
            master.wait_for(" ended STOP")
            knob.end(signal.SIGKILL)
        motors.wait_for("left_motor 0 %")  # its partner is lost: the safe value

"""A part that ends while STOP holds: who could not be made safe stays named, though it says goodbye."""

from __future__ import annotations

import pytest

from msbot import Level, Part
from msbot.testing import robot_for


@pytest.mark.promise("Only a part itself confirms STOP")
@pytest.mark.parametrize("is_broken", [True, False])
def test_a_part_that_could_not_be_made_safe_says_so_with_its_goodbye(is_broken: bool) -> None:
    part = Part("my:motor", uid=bytes(8), describes="a motor")

    @part.on("power", Level, safe=Level(percent=0))
    def drive(message: Level) -> None:
        if is_broken and message.percent == 0:
            raise OSError("no answer from the motor")

    with robot_for(part) as robot:
        robot.send("power", Level(percent=40))
        robot.stop()
        robot.advance(1)
        robot._in_loop(part.end)
        robot.advance(20)
        assert robot._master.stop.silent == (("my:motor",) if is_broken else ())
        robot.go()
        robot.advance(1)
        assert robot._master.stop.silent == ()

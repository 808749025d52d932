"""Follows a line: the further it is to one side, the more the robot turns there. `msbot demo --world line` has one."""

from msbot import Level, Line, Part

part = Part("PILOT")


@part.on("line", Line)
def steer(line):
    turn = 30 * line.position  # a line that is lost was last seen on that side
    part.publish("left", Level(percent=35 + turn))
    part.publish("right", Level(percent=35 - turn))


part.run()

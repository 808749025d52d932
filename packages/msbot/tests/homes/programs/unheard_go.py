"""A part that is on its way into the robot while STOP is said, and GO."""

from msbot import Level, Part

part = Part("TEST-1")


@part.on("power", Level)
def turn(message):
    print("power", message.percent, part.stopped)


part.run()

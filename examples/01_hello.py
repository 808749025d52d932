"""A part that speaks: AA's role in the sample robot (start `msbot master robot.toml` first)."""

from msbot import HelloWorld, Part

part = Part("ABCD", robot="MSBOT_MASTER")


@part.every(1.0)
def speak():
    part.publish("out", HelloWorld(index=1, message="Publisher A(1) turn-on 3"))


part.run()

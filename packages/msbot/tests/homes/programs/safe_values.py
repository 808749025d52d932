"""What a port is put to when nobody is in command."""

from msbot import Level, Part

part = Part("TEST-1")


@part.on("power", Level)
def turn(message):
    print("power", message.percent)


@part.safe_state
def safe():
    print("safe")


@part.on_lost
def lost():
    print("lost", part.state.value)


@part.on_join
def joined():
    print("joined")


part.run()

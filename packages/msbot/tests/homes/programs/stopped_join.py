"""A part that comes in while STOP holds."""

from msbot import Level, Part

part = Part("TEST-1")


@part.on("power", Level)
def turn(message):
    print("power", message.percent, part.stopped)


@part.safe_state
def safe():
    print("safe")


@part.on_stop
def stop():
    print("stop", part.stopped)


@part.on_go
def go():
    print("go", part.stopped, part.counters.held)


@part.on_identify
def blink():
    print("here I am")


part.run()

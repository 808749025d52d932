"""Nobody sends any more."""

from msbot import Level, Part

part = Part("TEST-1")


@part.on("power", Level)
def turn(message):
    print("power", message.percent)


@part.on_partner_lost
def alone(port):
    print("nobody sends to", port, part.state.value)


part.run()

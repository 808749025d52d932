"""A part that the robot does not know says what it is."""

from msbot import Level, Message, Part, float32, uint8


class Wind(Message):
    units = {"direction": "deg", "speed": "m/s"}
    speed: float32
    direction: uint8 = 3


part = Part("VANE-1", local_name="roof", describes='Weather "vane"')
part.publishes("wind", Wind)
part.publishes("spare", Level)


@part.on("brake", Level, safe=Level(percent=100), ranges={"percent": (0, 100)})
def brake(level):
    print(level)


@part.on_setting("gain", int, default=2, least=1, most=10, unit="x")
def gain(value):
    print("gain", value)


@part.on_setting("loud", bool, default=True)
def loud(value):
    print("loud", value)


@part.every("period_s", default=0.5)
def measure():
    part.publish("wind", Wind(speed=2.5))


@part.on_join
def joined():
    print("nobody hears it:", part.publish("spare", Level(percent=1)))


part.run()

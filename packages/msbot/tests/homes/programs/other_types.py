"""The robot's library has other fields in two messages than this program, and the same ones in two."""

from msbot import Count, Level, Message, Part, float32, uint16


class Raw(Message):
    value: uint16


class Pair(Message):
    x: float32
    y: float32


part = Part("TEST-1", local_name="roof")
part.publishes("out", Raw)


@part.on("in", Pair)
def pair(message):
    print(message)


@part.on("level", Level)
def level(message):
    print(message)


@part.every(1.0)
def count():
    part.publish("count", Count(value=1))


part.run()

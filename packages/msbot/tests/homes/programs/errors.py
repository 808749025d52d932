"""A mistake in a function is said once, with its line; the part goes on."""

from msbot import HelloWorld, Part

part = Part("TEST-1")


def check(index):
    if index % 2:
        raise ValueError("an odd index")


@part.on("in", HelloWorld)
def hear(message):
    check(message.index)
    print("fine", message.index)
    if message.index == 4:
        raise RuntimeError("four is too many")


@part.every(1.0)
def report():
    print("errors", part.counters.handler_errors)


part.run()

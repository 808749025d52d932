"""Functions that wait, and everything else goes on; STOP holds them; what begins during STOP goes on."""

from msbot import Count, HelloWorld, Level, Part

part = Part("TEST-1")


@part.on_join
def walk():
    for value in range(3):
        part.publish("out", Count(value=value))
        yield 0.5
    print("walked")
    yield 100
    print("never: the part is lost before")


@part.on("in", HelloWorld)
def greet(message):
    print("greet", message.index)
    yield 0.25
    print("greeted", message.index)


@part.on("power", Level)
def turn(message):
    print("power", message.percent)
    yield 0.3
    print("power done", message.percent)


@part.on_stop
def stop():
    part.start(walk_on)
    yield 0.2
    print("stopped", part.stopped)


@part.on_go
def go():
    print("go")


def walk_on():
    yield 0.1
    print("walks on")
    part.start(walk_on)
    try:
        yield "soon"
    except ValueError as error:
        print(error)
    yield 0
    part.start(fall)


def fall():
    yield 0.1
    raise RuntimeError("fallen")


@part.on_lost
def lost():
    print("lost")
    yield 0.1
    print("still lost")


part.run()

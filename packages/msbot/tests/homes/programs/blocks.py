# Made of blocks.
from msbot import Colour, Count, HelloWorld, Level, Part, Text

part = Part("TEST-1")
Zaehler = 0
i = 0
passes = 0
level = Level()
in_ = HelloWorld()


@part.on("in", HelloWorld)
def when_in(message):
    global in_
    in_ = message
    when_in_blocks()
    when_in_2_blocks()


def when_in_blocks():
    print("heard “ä\\\" " + in_.message)
    part.publish("word", Text(text=str(in_.index) + ""))


def when_in_2_blocks():
    global i
    for i in range(1, 4):
        if i == 2:
            print(min(max(150, -100), 100))
        else:
            print(i)


@part.on("level", Level)
def when_level(message):
    global level
    level = message


@part.on_join
def when_join():
    global Zaehler, passes
    Zaehler = 0
    for count in range(3):
        Zaehler = Zaehler + 1
        part.publish("out", Count(value=round(Zaehler)))
        yield 0.3
    while not level.percent > 50:
        passes = passes + 1
        yield 0.05
    print(passes > 2)
    while True:
        yield 1
        if not part.stopped:
            part.publish("colour", Colour(red=round(2.5 * 50), green=7, blue=0))
            break


@part.every(0.5)
def every():
    if part.bound("out") and passes < 0:
        print("never")


@part.on_stop
def when_stop():
    print("stopped")
    print(part.setting("gain", float, 1))


@part.on_go
def when_go():
    yield 0.2
    print("on we go")
    part.end()


part.run()

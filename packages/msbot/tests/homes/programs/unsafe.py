"""A part whose safe state fails at first: it does not say that it is safe before it is."""

from msbot import Level, Part

part = Part("TEST-1")
broken = True


@part.on_setting("broken", bool)
def mend(value):
    global broken
    broken = value


@part.on("power", Level)
def turn(message):
    if broken:
        raise RuntimeError("the motor does not answer")
    print("power", message.percent)


@part.on_stop
def stop():
    print("stop")


part.run()

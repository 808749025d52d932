"""What cannot be is said in words, and the part goes on."""

from msbot import ConfigError, Count, HelloWorld, LocalProtocolError, Part, Switch

part = Part("TEST-1")


def attempt(what):
    try:
        what()
    except (ConfigError, LocalProtocolError) as error:
        print(type(error).__name__, error)


attempt(lambda: part.publish("out", HelloWorld()))
attempt(lambda: part.every(0))
attempt(lambda: part.on("in", str))
attempt(lambda: part.setting("gain", list))
attempt(lambda: part.board)
attempt(lambda: Part("X", uid=b"short"))


@part.on_join
def begin():
    print("joined")
    attempt(lambda: part.publish("out", Switch(on=True)))
    attempt(lambda: part.publish("nowhere", Switch(on=True)))
    attempt(lambda: part.publish("out", "words"))
    attempt(lambda: part.publish("out", HelloWorld))
    attempt(lambda: Count(value=1 << 31))
    attempt(lambda: Switch(on=1))
    attempt(lambda: HelloWorld(message="a\0b"))
    attempt(lambda: part.setting("gain", float))
    attempt(lambda: part.setting("name", int))
    print(part.setting("gain", float, 2.5), part.setting("name"), part.bound("out"), part.bound("nowhere"))


part.run()

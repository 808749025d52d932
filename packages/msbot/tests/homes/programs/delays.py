"""Functions that are called once, some time later: declared, from functions, and lost with the master."""

from msbot import ConfigError, LocalProtocolError, Part

part = Part("TEST-1")
asked = 0


@part.after(0.4)
def declared():
    print("0.4 s after it joined")
    part.after(0.3, third)


def third():
    print("0.7 s")
    part.after(600, never)


def never():
    print("never: the master is gone before")


@part.on_join
def joined():
    print("joined")

    @part.after(0.2)
    def soon():
        print("0.2 s")


@part.on_lost
def lost():
    print("lost")
    try:
        part.after(1, third)
    except LocalProtocolError as error:
        print(str(error).partition(" (")[0], "...", str(error).rpartition(": ")[2])


for wrong in ((-1, third), (1, "third")):
    try:
        part.after(*wrong)
    except ConfigError:
        print("refused")

part.run()

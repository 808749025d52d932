"""A program's log: lines here and in the robot, what is too long, what comes too fast, and no such level."""

from msbot import ConfigError, Part

part = Part("TEST-1")

try:
    part.log("x", level="loud")
except ConfigError as error:
    print(error)


@part.on_join
def joined():
    part.log("it is warm")
    part.log("hot: 90 °C", level="warning")
    part.log("line\nand line\x07", level="error")
    part.log("ä" * 100)


@part.after(1.5)
def many():
    for number in range(30):
        part.log(number)


@part.after(4.5)
def again():
    part.log("again")


part.run()

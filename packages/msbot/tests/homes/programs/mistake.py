"""A port that the robot does not bind: the program is wrong, and ends with one sentence."""

from msbot import HelloWorld, Part

part = Part("TEST-1")


@part.every(1.0)
def speak():
    print("speaks")
    part.publish("mouth", HelloWorld())


@part.on("ear", HelloWorld)
def hear(message):
    print(message)


@part.on_end
def end():
    print("end")


part.run()

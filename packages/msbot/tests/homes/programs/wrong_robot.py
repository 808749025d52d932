"""A part that is made for another robot says nothing about itself."""

from msbot import ExpectedRobot, Part

part = Part("TEST-1", robot=ExpectedRobot("CLASSROOM", version="2"))


@part.on_join
def joined():
    print("joined")


part.run()

"""A part that the robot does not know."""

from msbot import Part

part = Part("NOBODY-9", local_name="somebody")


@part.on_join
def joined():
    print("joined")


part.run()

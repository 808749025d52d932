"""A part that is put into another slot, whose configuration has the same version."""

from msbot import Part

part = Part("TEST-1", local_name="mine")


@part.on_setting("gain", float)
def gain(value):
    print("gain", value)


@part.on_join
def joined():
    print("joined")


part.run()

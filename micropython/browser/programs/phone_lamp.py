"""This phone is a colour lamp: it shines in the colour that it is told, and is dark when nobody is in command."""

import device
from msbot import Colour, Part

part = Part("RGB-LED", local_name="phone")


@part.on("colour", Colour)
def shine(colour):
    device.colour(colour.red, colour.green, colour.blue)


@part.safe_state
def dark():
    device.colour(0, 0, 0)


part.run()

"""This phone is a joystick: tilt it. Button 1 is the stick's button; without a tilt the slider is its y axis."""

import device
from msbot import Part, Stick

part = Part("KY-023", local_name="phone")


def percent(degrees):
    return max(-100.0, min(100.0, degrees * 100 / 45))


@part.every(0.1)
def tell():
    if not part.bound("stick"):
        return
    tilt = device.tilt()
    y = -percent(tilt.y) if tilt.x or tilt.y else device.slider()
    part.publish("stick", Stick(x=percent(tilt.x), y=y, pressed=device.button(1)))


@part.on_identify
def here():
    device.vibrate(0.5)
    device.tone(880, 0.5)


part.run()

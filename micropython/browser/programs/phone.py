"""This phone is a part (PHONE): it tells tilt, buttons, slider and clock, and shines, sounds and shakes as told."""

import device
from msbot import Colour, Level, Part, Switch, Text, Tone

part = Part("PHONE", local_name="phone")
told = {}
is_on = {"vibration": False}


def tell(port, message):
    """Publish it if the port is wired."""
    if part.bound(port):
        part.publish(port, message)


def tell_change(port, now, message):
    """Publish what has changed since it was told last."""
    if told.get(port) != now:
        told[port] = now
        tell(port, message)


@part.every("period_s", default=0.1)
def measure():
    if device.has_tilt():
        tell("tilt", device.tilt())
    tell("slider", Level(percent=device.slider()))
    for number in range(1, 5):
        is_down = device.button(number)
        tell_change(f"button_{number}", is_down, Switch(on=is_down))
    time = "%02d:%02d:%02d" % device.clock()
    tell_change("clock", time, Text(text=time))


@part.every(1.0)
def say_all_again():
    told.clear()  # for whoever has been wired since
    if is_on["vibration"]:
        device.vibrate(1.5)


@part.on("colour", Colour)
def shine(colour):
    device.colour(colour.red, colour.green, colour.blue)


@part.on("tone", Tone)
def sound(tone):
    device.tone(tone.hertz, tone.seconds or 10.0)


@part.on("vibration", Switch)
def shake(switch):
    is_on["vibration"] = switch.on
    device.vibrate(1.5 if switch.on else 0)


@part.safe_state
def rest():
    is_on["vibration"] = False
    device.colour(0, 0, 0)
    device.tone(0)
    device.vibrate(0)


@part.on_identify
def here():
    device.vibrate(0.5)
    device.tone(880, 0.5)


part.run()

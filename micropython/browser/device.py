"""The phone, tablet or computer whose browser runs the program (docs/reference/part.md#the-device).

import device

tilt = device.tilt()            # Vector: degrees to the right, away from you, turned
device.colour(255, 0, 0)        # of the panel "Device" on the page
"""

from msbot import LocalProtocolError, Vector

values = {}  # the page's measurements, updated about 20 times a second while the program runs
acts = []  # what the page has to do; emptied after each step

_MOST = 16
_LONGEST_S = 10.0


def tilt():
    """How the device is tilted: a `Vector`, x degrees to the right, y towards you, z turned; zeros until it is
    known."""
    x, y, z = values.get("tilt", (0, 0, 0))
    return Vector(x=float(x), y=float(y), z=float(z))


def has_tilt():
    """Whether the device has told its tilt: computers have none, and browsers tell it on https pages only."""
    return "tilt" in values


def button(number=1):
    """Whether that button of the panel, 1 to 4, is held down now."""
    _check("button", number, 1, 4)
    return bool(values.get(f"button{number}", False))


def slider():
    """The position of the panel's slider, 0 to 100."""
    return float(values.get("slider", 0))


def clock():
    """The device's local time: (hours, minutes, seconds)."""
    return tuple(values.get("clock", (0, 0, 0)))


def colour(red, green, blue):
    """Show a colour on the panel, each 0 to 255."""
    for name, share in (("red", red), ("green", green), ("blue", blue)):
        _check(name, share, 0, 255)
    _do("colour", int(red), int(green), int(blue))


def tone(hertz, seconds=0.2):
    """Sound a tone; 0 Hz is silence."""
    _check("hertz", hertz, 0, 20000)
    _do("tone", hertz, min(max(0.0, seconds), _LONGEST_S))


def vibrate(seconds=0.2):
    """Vibrate, where the device can; 0 s ends it."""
    _do("vibrate", min(max(0.0, seconds), _LONGEST_S))


def _check(name, value, least, most):
    if not least <= value <= most:
        raise LocalProtocolError(f"{name} is {value}, not from {least} to {most}")


def _do(*act):
    """Only the last act of each kind counts: of a thousand colour changes, only the last is shown."""
    acts[:] = [known for known in acts if known[0] != act[0]][-_MOST:]
    acts.append(act)

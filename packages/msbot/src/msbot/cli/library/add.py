"""Puts a part type into a robot's own library folder: a file that exists, or a commented one to fill in."""

from __future__ import annotations

import os
import re
from pathlib import Path

from msbot.config import load_library
from msbot_agent.text.given_file import read_given
from msbot_xrce.errors import ConfigError

TEMPLATE = """\
# A part type of this robot. Every key: docs/reference/library.md. Check it with:  msbot library check FOLDER
number = "NUMBER"                # what the part shows to its robot
name = "My part"                 # what it is, in a few words
manufacturer = ""
description = ""
specification = ""               # electrical data in words, for example "5V"
category = "other"               # sensor, input, actuator, display, power, board or other
keywords = []                    # words by which `msbot library search` finds it
# compatible_with = ["SG90"]     # part numbers whose slots it can fill as well: it must have all their ports

# [supply]
# min_v = 5
# max_v = 5
# current_ma = 20

# [[pin]]
# name = "VCC"
# kind = "power"                 # power, ground, signal, bus or unused

# Ports: what it says and takes. Message types: docs/reference/library.md, or a [[type]] of your own.

[[port]]
name = "value"
direction = "publish"
type = "Number"
rate_hz = 2

# [[port]]
# name = "on"
# direction = "subscribe"
# type = "Switch"
# safe = { on = false }          # what holds when the master or the partner is lost, or on STOP

# Parameters: what can be set for a slot.

# [[parameter]]
# name = "period_s"
# type = "float"                 # bool, int, float or text
# default = 0.5
# min = 0.05
# max = 60
# unit = "s"
# description = "Time between two measurements"

# The simulator: what a person does to the thing, what one sees. Left out, each port gets a knob or a display.

# [[simulator.control]]
# name = "warmth"
# type = "number"
# start = 20
# min = -20
# max = 60
# unit = "°C"
# words = "Warm or cool it"
"""
"""What `msbot library add NUMBER` writes."""

_MOST_BYTES = 256_000
_ODD = re.compile(r"[^A-Za-z0-9._-]")


def add_file(source: Path, folder: Path) -> Path:
    """Check a file together with the library that it will be part of, and copy it; returns the path of the copy.

    Raises:
        ConfigError: it has mistakes, already exists, or cannot be written.
    """
    others = [path for path in sorted(folder.glob("*.toml")) if path.name != source.name]
    load_library(*others, source)
    return _write(folder / source.name, read_given(source, _MOST_BYTES, "a part type").decode("utf-8-sig"))


def add_template(number: str, folder: Path) -> Path:
    """Write a template for a new part number; returns its path.

    Raises:
        ConfigError: the number is taken or invalid, or the file already exists or cannot be written.
    """
    if os.sep in number and Path(number).exists():
        raise ConfigError(f"{number} is no part number and no file of a part type: such files end in .toml")
    if not any(map(str.isalnum, number)) or not number.isprintable() or any(sign in number for sign in '@"\\'):
        raise ConfigError(f'{number!r} cannot be a part number: use letters, digits and "-"')
    library = load_library(*([folder] if folder.is_dir() else []))
    if taken := library.get(number):
        raise ConfigError(f"part number {number!r} is taken by {taken.source}; choose another")
    return _write(folder / f"{_ODD.sub('_', number)}.toml", TEMPLATE.replace('"NUMBER"', f'"{number}"'))


def _write(path: Path, text: str) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8") as stream:
            stream.write(text)
    except FileExistsError:
        raise ConfigError(f"{path}: exists already and is not overwritten; change it with an editor") from None
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written ({error.strerror}); choose another folder with --to") from None
    return path

"""The sample blueprint: the thesis' robot, with every key explained (thesis 4.3)."""

from __future__ import annotations

import shlex
from pathlib import Path

from msbot_xrce.errors import ConfigError

# A second sample: a robot of ordinary library parts, for those who want to turn a knob and see something move.


ROVER_ROBOT_TOML = """\
# A robot of ordinary parts: what a person does to the one at the left, the one at the right follows.
# Start it with:  msbot demo --robot rover    (everything simulated), or with real parts:  msbot master robot.toml

[robot]
name = "ROVER"
version = "ROVER_V1"
serial_number = "R-0001"
released = "2026"
manufacturer = "MsBOT"

[timing]
preset = "thesis"

[options]
explain = true                             # a refused part is told why

[[slot]]
name = "knob"
part = "POT-10K"
description = "Sets how strongly the fan blows"

[slot.settings]
period_s = 0.5                             # a turn is published at once; a knob at rest says so twice a second

[[slot]]
name = "fan"
part = "FAN-5V"
description = "Cools the motors"

[[slot]]
name = "button"
part = "BUTTON"
description = "Headlight as long as it is held"

[[slot]]
name = "headlight"
part = "LED"
description = "Shines ahead"

[[slot]]
name = "eye"
part = "TCS34725"
description = "Looks at the colour of the floor"

[[slot]]
name = "beacon"
part = "RGB-LED"
description = "Shows the colour that the eye sees"

[[slot]]
name = "ear"
part = "KY-037"
description = "Listens how loud it is"

[[slot]]
name = "hand"
part = "GRIPPER"
description = "Closes when somebody claps"

[[slot]]
name = "bumper"
part = "KY-032"
description = "Sees obstacles"

[[slot]]
name = "horn"
part = "RELAY-1"
description = "Sounds at an obstacle"

[[binding]]
topic = "fan_power"
type = "Level"
from = "knob.level"
to = ["fan.power"]

[[binding]]
topic = "headlight_on"
type = "Switch"
from = "button.pressed"
to = ["headlight.on"]

[[binding]]
topic = "floor_colour"
type = "Colour"
from = "eye.colour"
to = ["beacon.colour"]
reliable = false                           # best effort: the newest colour matters more than each one

[[binding]]
topic = "loudness"
type = "Level"
from = "ear.level"
to = ["hand.grip"]
reliable = false

[[binding]]
topic = "obstacle"
type = "Switch"
from = "bumper.near"
to = ["horn.on"]
"""


# A third sample: a robot that drives, in a world or on a table.


BUGGY_ROBOT_TOML = """\
# A small robot that drives: two motors, a dozen sensors, a gripper. One slot is for a program of yours, the pilot.
# Start it with:  msbot demo --world line    (everything simulated), or with real parts:  msbot master robot.toml

[robot]
name = "BUGGY"
version = "BUGGY_V1"
serial_number = "B-0001"
released = "2026"
manufacturer = "MsBOT"

[timing]
preset = "fast"

[options]
explain = true                             # a refused part is told why

[[slot]]
name = "pilot"
part = "PILOT"
description = "A program that drives, or you on the page"

[[slot]]
name = "wheels"
part = "TB6612FNG"
description = "Two motors"

[[slot]]
name = "rear_wheels"
part = "TB6612FNG"
description = "The rear motors of a robot with four; on a robot with two they drive nothing"

[[slot]]
name = "line"
part = "QTR-8A"
description = "Looks for a line below the front edge"

[slot.settings]
period_s = 0.04

[[slot]]
name = "eyes"
part = "HC-SR04"
description = "Looks ahead"

[[slot]]
name = "floor"
part = "TCS34725"
description = "Looks at the colour of the floor"

[[slot]]
name = "bumper"
part = "BUTTON"
description = "At the front edge"

[[slot]]
name = "left_wheel"
part = "LM393-SPEED"
description = "Encoder of the left wheel"

[[slot]]
name = "right_wheel"
part = "LM393-SPEED"
description = "Encoder of the right wheel"

[[slot]]
name = "motion"
part = "MPU-6050"
description = "Feels turning and pushing"

[slot.settings]
period_s = 0.1

[[slot]]
name = "compass"
part = "HMC5883L"
description = "Knows where north is"

[[slot]]
name = "ear"
part = "KY-037"
description = "Listens how loud it is"

[[slot]]
name = "reed"
part = "KY-025"
description = "Feels magnets in the floor"

[[slot]]
name = "hand"
part = "GRIPPER"
description = "Holds boxes"

[[slot]]
name = "horn"
part = "BUZZER"
description = "Can be heard by other robots"

[[slot]]
name = "lamp"
part = "RGB-LED"
description = "Can be seen by other robots"

[[binding]]
topic = "power_left"
type = "Level"
from = "pilot.left"
to = ["wheels.left"]

[[binding]]
topic = "power_right"
type = "Level"
from = "pilot.right"
to = ["wheels.right"]

[[binding]]
topic = "power_rear_left"
type = "Level"
from = "pilot.rear_left"
to = ["rear_wheels.left"]

[[binding]]
topic = "power_rear_right"
type = "Level"
from = "pilot.rear_right"
to = ["rear_wheels.right"]

[[binding]]
topic = "line"
type = "Line"
from = "line.line"
to = ["pilot.line"]
reliable = false

[[binding]]
topic = "distance"
type = "Distance"
from = "eyes.distance"
to = ["pilot.distance"]
reliable = false

[[binding]]
topic = "colour"
type = "Colour"
from = "floor.colour"
to = ["pilot.colour"]
reliable = false

[[binding]]
topic = "light"
type = "Light"
from = "floor.light"
to = ["pilot.light"]
reliable = false

[[binding]]
topic = "touch"
type = "Switch"
from = "bumper.pressed"
to = ["pilot.touch"]

[[binding]]
topic = "left_speed"
type = "Speed"
from = "left_wheel.speed"
to = ["pilot.left_speed"]
reliable = false

[[binding]]
topic = "right_speed"
type = "Speed"
from = "right_wheel.speed"
to = ["pilot.right_speed"]
reliable = false

[[binding]]
topic = "rotation"
type = "Vector"
from = "motion.rotation"
to = ["pilot.rotation"]
reliable = false

[[binding]]
topic = "heading"
type = "Angle"
from = "compass.heading"
to = ["pilot.heading"]
reliable = false

[[binding]]
topic = "sound"
type = "Level"
from = "ear.level"
to = ["pilot.sound"]
reliable = false

[[binding]]
topic = "magnet"
type = "Switch"
from = "reed.closed"
to = ["pilot.magnet"]

[[binding]]
topic = "grip"
type = "Level"
from = "pilot.grip"
to = ["hand.grip"]

[[binding]]
topic = "holding"
type = "Switch"
from = "hand.holding"
to = ["pilot.holding"]

[[binding]]
topic = "tone"
type = "Tone"
from = "pilot.tone"
to = ["horn.tone"]

[[binding]]
topic = "lamp_colour"
type = "Colour"
from = "pilot.lamp"
to = ["lamp.colour"]
"""


SAMPLE_ROBOT_TOML = """\
# The blueprint of a robot: who it is, which parts it has, and who talks to whom.
# Lines that begin with # are comments. Start the robot with:  msbot master robot.toml

[robot]                                    # the profile: what the master publishes about the robot
name = "MSBOT_MASTER"                      # parts look for a robot of this name ...
version = "MSBOT_V1"                       # ... and may insist on a version
serial_number = "X100Y100Z100"
released = "8-4-2021"                      # any text
manufacturer = "MASSEY_ENGINEERING_DEP"

[timing]
preset = "thesis"                          # "thesis": a silent part is delisted after 4 to 6 s; "fast": 1.0 to 1.5 s
# beat_period_s = 1.0                      # a part beats that often
# tick_period_s = 2.0                      # every life status is decremented that often
# life = 3                                 # life status after each beat; at 0 the part is delisted
# profile_period_s = 5.0                   # the profile is repeated that often

[options]
explain = true                             # a refused part is told why; false: silence, as in the thesis
free_topics = []                           # topics that everybody may use without being a part
authentication = "open"                    # "key": each part must prove that it knows its key (`msbot key new`)

# Slots are the roles of the robot. Any part with the right number can fill a slot; the slot keeps its settings and
# its history when the part is replaced.

[[slot]]
name = "AA"
part = "ABCD"                              # part number, a type of the library
local_name = "ABCD-local"                  # optional: decides when several slots take the same part number
description = "Light sensor, 5V"

[[slot]]
name = "BB"
part = "EFGH"
local_name = "EFGH-local"
description = "Toggle switch, 5V"

[[slot]]
name = "CC"
part = "WXYZ"
local_name = "WXYZ-local"
description = "Motor driver, 5V"

# A part type may have parameters (those of the sample have none); a slot sets them in a table right below itself:
# [slot.settings]
# period_s = 0.5

# Bindings are the wires: one publishing port, any number of subscribing ports, written SLOT.port.
# The sample is a ring: AA tells BB, BB tells CC, CC tells AA.

[[binding]]
topic = "HelloWorldTopic_1_to_2"
type = "HelloWorld"                        # message type; the ports must carry the same one
from = "AA.out"
to = ["BB.in"]
reliable = true                            # false: best effort, only the newest sample matters

[[binding]]
topic = "HelloWorldTopic_2_to_3"
type = "HelloWorld"
from = "BB.out"
to = ["CC.in"]

[[binding]]
topic = "HelloWorldTopic_3_to_1"
type = "HelloWorld"
from = "CC.out"
to = ["AA.in"]
"""
"""What `msbot init` writes."""


SAMPLES = {"thesis": SAMPLE_ROBOT_TOML, "rover": ROVER_ROBOT_TOML, "buggy": BUGGY_ROBOT_TOML}
"""The sample blueprints by name."""


def write_sample(path: Path, sample: str = "thesis") -> None:
    """Write a sample blueprint to a new file; raises as `write_new`.

    Args:
        path: the file.
        sample: a name in `SAMPLES`.
    """
    write_new(path, SAMPLES[sample])


def write_new(path: Path, text: str) -> None:
    """Write a text to a new file.

    Raises:
        ConfigError: the file exists (it is never overwritten) or cannot be written.
    """
    try:
        stream = path.open("x", encoding="utf-8")
    except FileExistsError:
        what = "is a directory" if path.is_dir() else "exists already and is not overwritten"
        raise ConfigError(f"{path}: {what}; choose another name, for example {_other_name(path)}") from None
    except FileNotFoundError:
        raise ConfigError(
            f"{path}: there is no folder {path.parent}; create it with `mkdir -p {shlex.quote(str(path.parent))}`"
        ) from None
    except PermissionError:
        raise ConfigError(f"{path}: no permission to write in {path.parent}; choose another folder") from None
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: cannot be written ({_reason(error)}); choose another name") from None
    try:
        with stream:
            stream.write(text)
    except OSError as error:
        path.unlink(missing_ok=True)
        raise ConfigError(f"{path}: cannot be written ({_reason(error)}); make room or choose another disk") from None


def _other_name(path: Path) -> Path:
    if path.is_dir():
        return path / "robot.toml"
    number = 2
    while (candidate := path.with_stem(f"{path.stem}{number}")).exists():
        number += 1
    return candidate


def _reason(error: OSError | ValueError) -> str:
    return error.strerror or str(error) if isinstance(error, OSError) else str(error)

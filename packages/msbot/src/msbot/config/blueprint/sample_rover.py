"""A second sample: a robot of ordinary library parts, for those who want to turn a knob and see something move."""

from __future__ import annotations

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

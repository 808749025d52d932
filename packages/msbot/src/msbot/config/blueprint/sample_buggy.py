"""A third sample: a robot that drives, in a world or on a table."""

from __future__ import annotations

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

"""Parks: drives along the cars, measures the gaps, and slides into one that is long enough.

`msbot demo --world parking` has a street.
"""

from msbot import Distance, Level, Part

part = Part("PILOT")

STEP_S = 0.05
SPEED = 40
FREE_M = 0.3  # farther away than a parked car
LONG = 0.9  # seconds at that speed: longer than the robot, and room to spare
state = "search"
free = 0.0  # how long the way to the right has been free
back = 0.0
metres = 0.0


@part.on("distance", Distance)
def look(distance):
    global metres
    metres = distance.metres


@part.every(STEP_S)
def drive():
    global state, free, back
    if state == "search":
        if metres > FREE_M:
            free += STEP_S
        elif free > LONG:
            state, back = "back", free / 2
        else:
            free = 0.0
        go(SPEED, 0)
    elif state == "back":
        back -= STEP_S
        go(-SPEED, 0)
        if back <= 0:
            state = "in"
    elif state == "in":
        go(0, 40)
        if metres < 0.2:
            state = "parked"
    else:
        go(0, 0)


def go(ahead, right):
    """Four Mecanum wheels: turned against each other they slide."""
    part.publish("left", Level(percent=ahead + right))
    part.publish("right", Level(percent=ahead - right))
    part.publish("rear_left", Level(percent=ahead - right))
    part.publish("rear_right", Level(percent=ahead + right))


part.run()

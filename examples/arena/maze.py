"""Gets out of a maze: keeps a hand at the right wall, cell by cell. `msbot demo --world maze` has one.

In the middle of each cell it looks to the right, ahead, to the left, and takes the first way that is free.
"""

from msbot import Angle, Distance, Level, Part, Speed, Switch

part = Part("PILOT")

STEP_S = 0.05
CELL_M = 0.4
MIDDLE_M = 0.09  # so far from its eyes is a wall when it stands in the middle of a cell
WHEEL_M = 0.065 * 3.1416  # the way of one turn
heading = distance = left_rpm = right_rpm = 0.0
found = False
plan = None


@part.on("heading", Angle)
def compass(angle):
    global heading
    heading = angle.degrees


@part.on("distance", Distance)
def look(seen):
    global distance
    distance = seen.metres if seen.in_range else 9.0


@part.on("left_speed", Speed)
def left_wheel(speed):
    global left_rpm
    left_rpm = abs(speed.rpm)


@part.on("right_speed", Speed)
def right_wheel(speed):
    global right_rpm
    right_rpm = abs(speed.rpm)


@part.on("magnet", Switch)
def goal(switch):
    global found
    found = found or switch.on


def explore():
    """Each `yield` is one step of time."""
    looks = 0.0
    while not found:
        looks += 90.0
        for _ in range(4):
            yield from turn_to(looks)
            yield from wait(0.4)  # until the eyes have looked anew
            if distance > CELL_M / 2 + MIDDLE_M:
                break
            yield from to_wall(looks)
            looks -= 90.0
        yield from ahead(looks)
    go(0, 0)


def turn_to(wanted):
    still = 0
    while still < 4:  # it must not swing through
        if abs(off(wanted)) < 3.0:
            still += 1
            go(0, 0)
        else:
            still = 0
            power = max(-30.0, min(30.0, 0.5 * off(wanted)))
            power += 10.0 if power > 0 else -10.0  # less does not move it
            go(power, -power)
        yield


def to_wall(wanted):
    """The middle of a cell is as far from each wall: go there while one is seen."""
    for _ in range(40):
        miss = distance - MIDDLE_M
        if abs(miss) < 0.012:
            break
        drive(18.0 if miss > 0 else -18.0, wanted)
        yield
    go(0, 0)


def ahead(wanted):
    """One cell; where a wall is seen, it says where the middle is."""
    way = 0.0
    end = distance - CELL_M if distance < 0.6 else None  # farther away it may be a wall beside the way
    while not found:
        way += (left_rpm + right_rpm) / 2 / 60 * WHEEL_M * STEP_S
        if distance <= MIDDLE_M or (way >= CELL_M if end is None else distance <= end):
            break
        drive(35.0, wanted)
        yield
    go(0, 0)
    yield from wait(0.3)


def wait(seconds):
    for _ in range(int(seconds / STEP_S)):
        yield


def off(wanted):
    return (wanted - heading + 540.0) % 360.0 - 180.0


def drive(power, wanted):
    turn = max(-10.0, min(10.0, 0.6 * off(wanted)))
    go(power + turn, power - turn)


def go(left, right):
    part.publish("left", Level(percent=left))
    part.publish("right", Level(percent=right))


@part.every(STEP_S)
def step():
    global plan
    if plan is None:
        plan = explore()
    next(plan, None)


part.run()

"""Sorts boxes by colour: looks around, fetches the nearest box, brings it to the field of its colour, and comes back.

`msbot demo --world sorting` has some. It knows where it is by counting what its wheels have turned, and by its compass.
The first boxes get home; then it is wrong by some centimetres, and misses. How could it find out where it really is?
"""

from math import atan2, cos, degrees, radians, sin

from msbot import Angle, Colour, Distance, Level, Part, Speed, Switch

part = Part("PILOT")

STEP_S = 0.05
WHEEL_M = 0.065 * 3.1416  # the way of one turn
HOME = (1.0, 0.25)
FIELDS = {"red": 0.2, "green": 1.0, "blue": 1.8}  # where their middles are, from the left
NOSE_M = 0.08  # from the middle of the robot to its eyes
x, y = HOME
heading = distance = left_rpm = right_rpm = 0.0
direction = 0.0
holds = False
colour = ""
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


@part.on("holding", Switch)
def feel(switch):
    global holds
    holds = switch.on


@part.on("colour", Colour)
def see(seen):
    global colour
    parts = {"red": seen.red, "green": seen.green, "blue": seen.blue}
    colour = max(parts, key=parts.get)


def sort():
    """Each `yield` is one step of time."""
    while True:
        yield from go_to(*HOME)
        found = yield from sweep(-85.0, 85.0)
        if found is None:
            go(0, 0)
            yield
            continue
        yield from turn_to(found)
        yield from ahead(0.13)
        found = yield from sweep(heading_now() - 35.0, heading_now() + 35.0)
        if found is not None:
            yield from turn_to(found)
            yield from ahead(0.035)
        yield from grip(100)
        if holds:
            yield from wait(0.5)  # until its colour has been seen
            field = FIELDS[colour]
            yield from go_to(field, 0.95)
            yield from go_to(field, 1.2)
        yield from grip(0)
        yield from back(0.2)


def sweep(begin, end):
    """Turn slowly from one direction to another; the direction of the nearest box, None: there is none."""
    yield from turn_to(begin)
    seen = []
    while off(end) > 0.0:
        go(14, -14)
        if is_box():
            seen.append((distance, heading_now()))
        yield
    go(0, 0)
    yield from wait(0.2)
    if not seen:
        return None
    nearest = min(seen)[0]
    near = [where for far, where in seen if far < nearest + 0.04]
    middle = min(seen)[1]
    near = [where for where in near if abs(where - middle) < 40.0]
    return sum(near) / len(near)


def is_box():
    """Nearer than the wall behind it, and not in a field."""
    s, c = sin(radians(heading)), cos(radians(heading))
    to_wall = [9.0]
    if s:
        to_wall.append(((2.0 - x) if s > 0 else -x) / s)
    if c:
        to_wall.append(((1.5 - y) if c > 0 else -y) / c)
    return distance < 0.75 * min(to_wall) - NOSE_M and y + (distance + NOSE_M) * c < 1.1


def turn_to(wanted):
    still, least = 0, 10.0
    while still < 4:  # it must not swing through
        if abs(off(wanted)) < 2.0:
            still, least = still + 1, 10.0
            go(0, 0)
        else:
            still = 0
            power = max(-25.0, min(25.0, 0.5 * off(wanted)))
            least = min(40.0, least + 0.2)  # with a box in its hand it needs more to move at all
            power += least if power > 0 else -least
            go(power, -power)
        yield


def ahead(until):
    """Until something is that near."""
    wanted = heading
    for _ in range(200):
        if distance <= until:
            break
        drive(22.0, wanted)
        yield
    go(0, 0)
    yield from wait(0.3)


def back(metres):
    wanted = heading
    begin = (x, y)
    while (x - begin[0]) ** 2 + (y - begin[1]) ** 2 < metres**2:
        drive(-30.0, wanted)
        yield
    go(0, 0)
    yield from wait(0.3)


def go_to(to_x, to_y):
    if (to_x - x) ** 2 + (to_y - y) ** 2 < 0.03**2:
        return
    yield from turn_to(bearing(to_x - x, to_y - y))
    for _ in range(400):
        if (to_x - x) ** 2 + (to_y - y) ** 2 < 0.03**2:
            break
        drive(35.0, bearing(to_x - x, to_y - y))
        yield
    go(0, 0)
    yield from wait(0.3)


def bearing(east, north):
    """The compass direction of a way."""
    return degrees(atan2(east, north))


def grip(percent):
    part.publish("grip", Level(percent=percent))
    yield from wait(1.0)


def wait(seconds):
    for _ in range(int(seconds / STEP_S)):
        yield


def heading_now():
    """Between -180 and 180."""
    return (heading + 180.0) % 360.0 - 180.0


def off(wanted):
    return (wanted - heading + 540.0) % 360.0 - 180.0


def drive(power, wanted):
    turn = max(-12.0, min(12.0, 0.6 * off(wanted)))
    go(power + turn, power - turn)


def go(left, right):
    global direction
    direction = 0.0 if left * right < 0 else 1.0 if left + right > 0 else -1.0 if left + right < 0 else direction
    part.publish("left", Level(percent=left))
    part.publish("right", Level(percent=right))


@part.every(STEP_S)
def step():
    global plan, x, y
    way = direction * (left_rpm + right_rpm) / 2 / 60 * WHEEL_M * STEP_S
    x += way * sin(radians(heading))
    y += way * cos(radians(heading))
    if plan is None:
        plan = sort()
    next(plan, None)


part.run()

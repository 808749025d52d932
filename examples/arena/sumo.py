"""Pushes the rival off the ring: look for it, then full power. `msbot demo --world sumo` has a ring."""

from msbot import Distance, Level, Line, Part

part = Part("PILOT")
back = 0  # steps of going back from the edge that are left
sees = None  # whether the rival is ahead; nothing was seen yet


@part.on("distance", Distance)
def look(distance):
    global sees
    sees = distance.in_range and distance.metres < 0.55  # a wall is farther away, mostly


@part.on("line", Line)
def drive(line):
    global back
    if not line.seen:  # the ring is dark, its edge is white
        back = 40
    if sees is None:
        go(0, 0)
    elif back > 0:  # first straight back, then turn round
        back -= 1
        go(-60, -60 if back > 25 else 60)
    elif sees:
        go(100, 100)
    else:
        go(25, -25)


def go(left, right):
    part.publish("left", Level(percent=left))
    part.publish("right", Level(percent=right))


part.run()

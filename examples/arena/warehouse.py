"""Fetches the crate: follows the line to it, grips it, and brings it to the loading place, where it feels a magnet.

`msbot demo --world warehouse` has one.
"""

from msbot import Distance, Level, Line, Part, Switch

part = Part("PILOT")

state = "turn"  # the crate is behind the robot
steps = 0
lost = False  # whether it has turned away from the line
metres = 9.0
holds = False
magnet = False


@part.on("distance", Distance)
def look(distance):
    global metres
    metres = distance.metres if distance.in_range else 9.0


@part.on("holding", Switch)
def feel(switch):
    global holds
    holds = switch.on


@part.on("magnet", Switch)
def feel_magnet(switch):
    global magnet
    magnet = switch.on


@part.on("line", Line)
def drive(line):
    """Each state drives in its own way, and says which one comes after it."""
    global state, steps, lost
    before = state
    steps += 1
    if state in ("turn", "turn back"):
        go(-35, 35)
        lost = lost or not line.seen
        if lost and line.seen and abs(line.position) < 0.5:
            state = "find" if state == "turn" else "bring"
    elif state == "find":
        follow(line)
        if metres < 0.025:
            state = "grip"
    elif state == "grip":
        go(0, 0)
        part.publish("grip", Level(percent=100))
        if holds and steps > 25:
            state = "turn back"
    elif state == "bring":
        follow(line)
        if magnet:
            state = "put down"
    elif state == "put down":
        go(0, 0)
        part.publish("grip", Level(percent=0))
        if steps > 30:
            state = "leave"
    elif state == "leave":
        go(-30, -30)
        if steps > 25:
            state = "done"
    else:
        go(0, 0)
    if state != before:
        steps, lost = 0, False


def follow(line):
    turn = 25 * line.position
    go(35 + turn, 35 - turn)


def go(left, right):
    part.publish("left", Level(percent=left))
    part.publish("right", Level(percent=right))


part.run()

"""Sentences for people, imported only when needed: memory on a board is scarce."""

import io
import sys

REFUSALS = (
    "this part number is not in the library",
    "this part is blocked",
    "another part with the same UID is active",
    "every fitting slot is taken, or it is not clear which one is meant",
    "this robot has no slot for this part number",
    "the claim makes no sense",
    "the inventory cannot read its registry",
    "the part's key is not the one on file for its UID",
    "this robot asks for keys, and the part proves none",
    "this robot asks for keys, and has none for this part",
    "an old proof was shown again, or one that nobody asked for",
)
_NO_SLOT = 4
_KEY_NEEDED = 9


def refusal(reason):
    """Why a claim was refused."""
    if not 0 < reason <= len(REFUSALS):
        return "refused for reason {}".format(reason)
    return REFUSALS[reason - 1]


def told_state(state, reason):
    """How the state of a refused part is told: without a free slot it is a spare that waits."""
    return "standby" if reason == REFUSALS[_NO_SLOT - 1] else state


def key_needed():
    """Why a part without a key gets no further."""
    return REFUSALS[_KEY_NEEDED - 1] + ": give it its key in msbot.json"


def bound(ports):
    """The bound ports of a part."""
    if not ports:
        return "this robot binds no port of the part"
    listed = ["{} ({} {})".format(p[0], "subscribe" if p[3] else "publish", p[2]) for p in ports]
    return "bound in this robot: " + ", ".join(listed)


def place(error):
    """The innermost line of the student's own code: `my_part.py:12 in measure`."""
    story = io.StringIO()
    sys.print_exception(error, story)
    found = None
    for line in story.getvalue().split("\n"):
        if line.startswith('  File "') and "msbot/" not in line:
            name, _, rest = line[8:].partition('", line ')
            number, _, function = rest.partition(", in ")
            found = "{}:{} in {}".format(name.split("/")[-1], number, function)
    return found

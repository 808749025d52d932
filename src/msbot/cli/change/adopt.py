"""`msbot adopt`: let a part into a slot."""

from __future__ import annotations

import click

from msbot.cli.change.robot_access import say
from msbot.cli.options import answer_options

WINDOW_S = 60.0


@click.command("adopt")
@click.argument("part", required=False)
@click.option("--slot", metavar="SLOT", help="The slot it goes into; else the one empty slot that fits.")
@click.option("--window", type=float, metavar="SECONDS",
              help="For so long, parts can be let in that the library does not know or that do not fit.")  # fmt: skip
@answer_options
def command(part: str | None, slot: str | None, window: float | None, db: str | None, robot: str | None) -> None:
    """Put PART, which stands by or is not let in, into a slot.

    Without PART the adoption window is opened (60 s unless told otherwise); with --slot, the next newcomer gets that
    slot: plug it in then.
    """
    if part is None or window is not None:
        wish = None if part is not None else slot
        say(db, robot, "window", {"seconds": WINDOW_S if window is None else window, "slot": wish})
    if part is not None:
        say(db, robot, "adopt", {"part": part, "slot": slot})

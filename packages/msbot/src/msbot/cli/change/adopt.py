"""`msbot adopt`: let a part into a slot."""

from __future__ import annotations

import shlex
from typing import Any

import click

from msbot.cli.change.robot_access import say
from msbot.cli.robot_options import answer_options, wants_json
from msbot_agent.cli.numbers import FiniteRange

WINDOW_S = 60.0


@click.command("adopt")
@click.argument("part", required=False)
@click.option("--slot", metavar="SLOT", help="The slot it goes into; else the one empty slot that fits.")
@click.option("--window", type=FiniteRange(), metavar="SECONDS",
              help="For so long, parts can be let in that the library does not know or that do not fit.")  # fmt: skip
@answer_options
def command(part: str | None, slot: str | None, window: float | None, db: str | None, robot: str | None) -> None:
    """Put PART, which stands by or is not let in, into a slot.

    A part that the library does not know, and that says what it is, gets a part type and a slot of its own; --slot says
    what the slot is called. The wires that fit are printed as commands.

    Without PART the adoption window is opened (60 s unless told otherwise); with --slot, the next newcomer gets that
    slot: plug it in then.
    """
    if part is None or window is not None:
        wish = None if part is not None else slot
        say(db, robot, "window", {"seconds": WINDOW_S if window is None else window, "slot": wish})
    if part is not None:
        for offer in say(db, robot, "adopt", {"part": part, "slot": slot}).get("offers", ()):
            if not wants_json():
                click.echo(f"  fits: {_bind(offer)}")


def _bind(offer: dict[str, Any]) -> str:
    """The command that makes a wire."""
    to = " ".join(f"--to {shlex.quote(end)}" for end in offer["to"])
    topic, kind, source = (shlex.quote(offer[key]) for key in ("topic", "type", "from"))
    return f"msbot bind {topic} --type {kind} --from {source} {to}"

"""`msbot log --follow`: what happens in the running robot, line by line."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from datetime import datetime
from typing import Any

import click

from msbot.cli.change.robot_access import MasterConnection
from msbot_agent.text.sentence import printable
from msbot_xrce.counting import amount

WAIT_S = 2.0
"""How long the master waits for the next line before it answers that there is none."""


def follow_log(
    db: str | None, robot: str | None, *, last: int, slots: Collection[str], goes_on: bool, as_json: bool
) -> None:
    """Print the last lines of the robot's log, and then each new one until Ctrl-C.

    Raises:
        ConfigError: no master runs here, or it ends meanwhile.
    """
    master = MasterConnection(db, robot)
    shown, after = 0, None
    try:
        while True:
            wait = None if after is None else WAIT_S
            answer = master.ask("log_lines", after=after, last=last, wait=wait)
            after = int(answer["next"])
            if answer["missed"]:
                click.echo(f"msbot: {amount(int(answer['missed']), 'line')} missed: read more quickly", err=True)
            for line in answer["lines"]:
                if not slots or line["slot"] in slots:
                    shown += 1
                    click.echo(json.dumps(line) if as_json else line_words(line))
            if not goes_on:
                return
    except KeyboardInterrupt:
        click.echo(f"\n{amount(shown, 'line')}", err=True)


def line_words(line: Mapping[str, Any]) -> str:
    """A line with its time, in words."""
    at = datetime.fromtimestamp(float(line["at"])).strftime("%H:%M:%S.%f")[:-3]
    level = "" if line["level"] == "info" else f"[{line['level']}] "
    return f"{at}  {level}{printable(str(line['words']))}"

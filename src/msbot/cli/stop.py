"""`msbot stop`: all parts go to their safe states."""

from __future__ import annotations

import time

import click

from msbot.cli.control import perform, robot_options, say

PATIENCE_S = 2.0
"""How long the command waits for the parts to confirm."""
LOOK_S = 0.05


@click.command("stop")
@click.option("--reason", default="", help="Why, for the people who see it.")
@click.option("--go", is_flag=True, help="End STOP: the parts may work again.")
@robot_options
def command(reason: str, db: str | None, robot: str | None, *, go: bool) -> None:
    """STOP: every part goes to its safe state at once, and stays there until `msbot stop --go`."""
    if go:
        say(db, robot, "go", {})
        return
    say(db, robot, "stop", {"reason": reason})
    until = time.monotonic() + PATIENCE_S
    while True:
        report = perform(db, robot, "stop_report", {})
        if report.get("latency_ms") is not None or not report["holds"] or time.monotonic() > until:
            break
        time.sleep(LOOK_S)
    click.echo(_words(report))


def _words(report: dict[str, object]) -> str:
    latency, told, confirmed = report.get("latency_ms"), report.get("told"), report.get("confirmed")
    if isinstance(latency, float):
        return f"all {told} have confirmed it within {latency:.1f} ms"
    return f"{confirmed} of {told} have confirmed it; look at the others"

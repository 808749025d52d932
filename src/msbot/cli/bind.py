"""`msbot bind`: join ports by a topic."""

from __future__ import annotations

import click

from msbot.cli.control import robot_options, say


@click.command("bind")
@click.argument("topic")
@click.option("--type", "type_name", required=True, metavar="TYPE", help="Message type of the topic, as HelloWorld.")
@click.option("--from", "source", metavar="SLOT.PORT", help="A port that publishes it.")
@click.option("--to", "targets", multiple=True, metavar="SLOT.PORT",
              help="A port that subscribes to it; may be given several times.")  # fmt: skip
@click.option("--best-effort", is_flag=True, help="The newest sample matters more than each sample.")
@robot_options
def command(
    topic: str, *, type_name: str, source: str | None, targets: tuple[str, ...], best_effort: bool,
    db: str | None, robot: str | None,
) -> None:  # fmt: skip
    """Join ports by TOPIC, besides those it joins already; the parts follow at once."""
    wish = {"topic": topic, "type": type_name, "from": source, "to": list(targets), "reliable": not best_effort}
    say(db, robot, "bind", wish)

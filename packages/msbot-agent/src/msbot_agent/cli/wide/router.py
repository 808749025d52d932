"""`msbot router`: what the sites of a wide network connect to."""

from __future__ import annotations

import asyncio
import contextlib
from pathlib import Path

import click

from msbot_agent.cli.until_ended import run_until_signal
from msbot_agent.process.end_signals import run_to_end
from msbot_agent.process.nonblocking_output import nonblocking_output


@click.command("router")
@click.argument("file", required=False, type=click.Path(path_type=Path))
def command(file: Path | None) -> None:
    """Run a Zenoh router for the sites of a wide network, until Ctrl-C.

    FILE (router.toml) says what it serves, with which certificates, and who may send and receive what. Without a file
    it serves this computer only, at port 7447.
    """
    from msbot_agent.space.zenoh import Router
    from msbot_agent.wide import RouterRules, read_router_file

    rules = RouterRules() if file is None else read_router_file(file)
    with (
        contextlib.suppress(KeyboardInterrupt),
        nonblocking_output(),
        Router(rules.listen, rules.connect, tls=rules.tls, allowed=rules.allowed),
    ):
        passes = f"{len(rules.allowed)} rule(s) say what passes" if rules.allowed else "everything passes"
        click.echo(f"router at {', '.join(rules.listen)}; {passes}; Ctrl-C ends it")
        run_to_end(run_until_signal(_wait()))


async def _wait() -> None:
    await asyncio.Event().wait()

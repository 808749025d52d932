"""`msbot gateway`: carries topics between a site's data space and the other sites."""

from __future__ import annotations

import contextlib
import logging
from pathlib import Path

import click

from msbot_agent.cli.until_ended import run_until_signal
from msbot_agent.log import TerminalHandler
from msbot_agent.process.end_signals import run_to_end
from msbot_agent.process.nonblocking_output import nonblocking_output
from msbot_agent.space import open_space
from msbot_agent.wide import Gateway, GatewayRules, read_gateway_file
from msbot_xrce.counting import amount


@click.command("gateway")
@click.argument("file", default="gateway.toml", type=click.Path(path_type=Path))
def command(file: Path) -> None:
    """Carry the topics that FILE (gateway.toml) lists between this site and the others, until Ctrl-C."""
    logging.basicConfig(level=logging.WARNING, handlers=[TerminalHandler()])
    rules = read_gateway_file(file)
    with contextlib.suppress(KeyboardInterrupt), nonblocking_output():
        run_to_end(_main(rules))


async def _main(rules: GatewayRules) -> None:
    with open_space(rules.inside) as inside, open_space(rules.outside) as outside:
        gateway = Gateway(inside, outside, (rules.inside, rules.outside), rules.crossings)
        here = inside.words or "this process"
        click.echo(f"gateway between {here} and {outside.words}; {len(rules.crossings)} topic(s); Ctrl-C ends it")
        try:
            await run_until_signal(gateway.run())
        finally:
            gateway.close()
            for topic, direction, number in gateway.crossed():
                click.echo(f"{topic}: {amount(number, 'sample')} crossed {direction}")

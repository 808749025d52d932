"""`msbot relay`: carries the parts of one link to a master elsewhere."""

from __future__ import annotations

import contextlib
import logging
import platform
from collections.abc import Callable
from dataclasses import replace

import click

from msbot_agent.cli.until_ended import run_until_signal
from msbot_agent.link import Link, open_link
from msbot_agent.link.can import CanSettings, Codec
from msbot_agent.link.relay import PartsRelay
from msbot_agent.log import TerminalHandler
from msbot_agent.process.end_signals import run_to_end
from msbot_agent.process.nonblocking_output import nonblocking_output
from msbot_xrce import compress, decompress, is_whole

_CAN = CanSettings(codec=Codec(compress, decompress), is_whole=is_whole)


@click.command("relay")
@click.argument("parts")
@click.argument("master")
@click.option(
    "--name",
    default=lambda: platform.node() or "relay",
    show_default="the computer's name",
    metavar="NAME",
    help="Name by which the master reports this relay.",
)
def command(parts: str, master: str, name: str) -> None:
    """Carry the parts on the link PARTS to the master at MASTER, until Ctrl-C.

    For a computer at the robot's bus, while the master runs elsewhere: `msbot relay can:can0
    udp:192.168.1.20:8888`. The parts keep their identity; the master reports where each of them is.
    """
    logging.basicConfig(level=logging.WARNING, handlers=[TerminalHandler()])

    def open_parts(profile_hash: int) -> Link:
        return open_link(parts, serve=True, can=replace(_CAN, profile_hash=profile_hash))

    open_parts(0)  # report mistakes before anything runs
    with contextlib.suppress(KeyboardInterrupt), nonblocking_output():
        run_to_end(_main(open_parts, open_link(master), name))


async def _main(open_parts: Callable[[int], Link], way: Link, name: str) -> None:
    relay = PartsRelay(open_parts, way, name=name, say=click.echo)
    click.echo(f"relay {name} looks for a master on {way.info.name}; Ctrl-C ends it")
    await run_until_signal(relay.run())

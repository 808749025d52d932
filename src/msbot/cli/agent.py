"""`msbot agent`: a DDS-XRCE agent for any client, without a robot."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal

import click

from msbot.agent import Agent
from msbot.link import Link, Peer, Signal, UdpServerLink
from msbot.space import MemorySpace

LEVELS = {0: logging.CRITICAL, 1: logging.CRITICAL, 2: logging.ERROR, 3: logging.WARNING, 4: logging.INFO}


@click.group("agent")
def command() -> None:
    """Run a DDS-XRCE agent that serves every client: micro-ROS boards, eProsima programs, MsBOT parts.

    Nothing is gated; what the clients create lives in this process' memory.
    """


@command.command("udp4")
@click.option("-p", "--port", type=click.IntRange(0, 65535), required=True, help="UDP port to listen on.")
@click.option(
    "--host", default="127.0.0.1", show_default=True, help="Address to listen on; 0.0.0.0 for every interface."
)
@click.option("-v", "--verbose", type=click.IntRange(0, 6), default=4, show_default=True, help="How much to say.")
def udp4(port: int, host: str, verbose: int) -> None:
    """Serve clients over UDP and IPv4."""
    logging.basicConfig(level=LEVELS.get(verbose, logging.DEBUG), format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_main(UdpServerLink(host, port)))


async def _main(link: UdpServerLink) -> None:
    agent = Agent(MemorySpace())
    agent.add_link(link)
    agent.on_signal = _say
    loop = asyncio.get_running_loop()
    async with asyncio.TaskGroup() as tasks:
        serving = tasks.create_task(agent.run())
        for number in (signal.SIGINT, signal.SIGTERM):
            with contextlib.suppress(NotImplementedError):
                loop.add_signal_handler(number, serving.cancel)


def _say(link: Link, signal: Signal, peer: Peer | None, reason: str, now: float) -> None:  # noqa: ARG001 - a handler's signature
    if signal is Signal.LINK_UP:
        click.echo(f"agent on {link.info.name}; Ctrl-C ends it")

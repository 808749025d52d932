"""Runs a DDS-XRCE agent on one link, as `msbot agent` was asked to."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import logging
from dataclasses import dataclass
from pathlib import Path

import click

from msbot.agent import Agent, AgentSettings, DiscoveryResponder, StatusServer
from msbot.cli.packets import packet_tap
from msbot.cli.running import run_until_signal
from msbot.errors import ConfigError
from msbot.link import Link, Peer, Signal, TcpServerLink, UdpServerLink
from msbot.link.tcp import MAX_CONNECTIONS
from msbot.space import MemorySpace
from msbot.xrce import References

LEVELS = (
    logging.CRITICAL + 1, logging.CRITICAL, logging.ERROR, logging.WARNING, logging.INFO, logging.DEBUG, logging.DEBUG
)  # fmt: skip
"""Levels of logging by the number behind `-v`."""
SAY_HELLO = 4
SAY_PACKETS = 6

FILES_BESIDES = 64
"""Files a process needs besides its connections."""


@dataclass(frozen=True, slots=True)
class Wishes:
    """What the user asked for, whatever the link."""

    verbose: int
    middleware: str
    refs: Path | None
    dead_after_s: float


@dataclass(frozen=True, slots=True)
class Discovery:
    """Where clients are told of the agent."""

    port: int
    interface: str | None
    """IPv4 address of the one interface; None = all."""


def serve(link: Link, wishes: Wishes, discovery: Discovery | None = None, *, hint: str = "") -> None:
    """Run an agent on that link until Ctrl-C or SIGTERM; `hint` is said with its greeting.

    Raises:
        ConfigError: the profile file cannot be used.
        LinkDown: the link or the discovery port cannot be opened; the text names the remedy.
    """
    logging.basicConfig(level=logging.WARNING, format="%(asctime)s %(message)s", datefmt="%H:%M:%S")
    logging.getLogger().setLevel(max(LEVELS[wishes.verbose], logging.WARNING))
    logging.getLogger("msbot").setLevel(LEVELS[wishes.verbose])  # the details of libraries are of no use here
    references = None if wishes.refs is None else read_references(wishes.refs)
    if isinstance(link, TcpServerLink):
        _allow_connections()
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(_main(link, wishes, references, discovery, hint))


def read_references(path: Path) -> References:
    """The profiles in a file.

    Raises:
        ConfigError: it cannot be read, or a profile is wrong; the text says where.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"cannot read the profiles in {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path} is no text in UTF-8") from error
    return References.parse(text, str(path))


def discovery_for(host: str, port: int | None) -> Discovery | None:
    """Discovery on a port for an agent that listens at that host; None without a port.

    Raises:
        ConfigError: the agent has no IPv4 address that could be told.
    """
    if port is None:
        return None
    if host in ("0.0.0.0", "::"):
        return Discovery(port, None)
    try:
        return Discovery(port, str(ipaddress.IPv4Address("127.0.0.1" if host == "localhost" else host)))
    except ValueError as error:
        raise ConfigError(
            f"--discovery tells IPv4 addresses, and --host {host} is none: use 0.0.0.0 or ::, or leave it out"
        ) from error


def _allow_connections() -> None:
    """Let the process have as many open files as it may: each TCP connection is one."""
    try:
        import resource
    except ImportError:
        return  # not on Windows, which has no such limit
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MAX_CONNECTIONS + FILES_BESIDES
    if soft != resource.RLIM_INFINITY and soft < wanted:
        most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


async def _main(
    link: Link, wishes: Wishes, references: References | None, discovery: Discovery | None, hint: str
) -> None:
    agent = Agent(MemorySpace(), settings=AgentSettings(dead_after_s=wishes.dead_after_s), references=references)
    agent.add_link(link)
    if wishes.verbose >= SAY_PACKETS:
        agent.tap = packet_tap(link, click.echo)
    up = asyncio.Event()

    def signalled(link: Link, signal: Signal, peer: Peer | None, reason: str, now: float) -> None:  # noqa: ARG001
        if signal is Signal.LINK_UP:
            if wishes.verbose >= SAY_HELLO and not up.is_set():
                _greet(link, reason, wishes, hint)
            up.set()

    agent.on_signal = signalled
    beside = [StatusServer(agent, what="agent", name=link.info.name).run()]
    if discovery is not None:
        beside.append(_answer_questions(link, up, discovery))
    await run_until_signal(agent.run(), beside=beside)


async def _answer_questions(link: Link, up: asyncio.Event, discovery: Discovery) -> None:
    await up.wait()
    assert isinstance(link, UdpServerLink | TcpServerLink)
    await DiscoveryResponder(link.port, port=discovery.port, interface=discovery.interface).run()


def _greet(link: Link, reason: str, wishes: Wishes, hint: str) -> None:
    name = link.info.name
    if isinstance(link, UdpServerLink | TcpServerLink):
        name = f"{name.rpartition(':')[0]}:{link.port}"  # where port 0 was asked for
        reason = ""
    words = ", ".join(filter(None, (f"agent on {name}", reason, hint)))
    click.echo(f"{words}; Ctrl-C ends it")
    if wishes.middleware != "ced":
        click.echo(f"-m {wishes.middleware}: samples stay in this process' memory, as with ced; DDS is not spoken here")

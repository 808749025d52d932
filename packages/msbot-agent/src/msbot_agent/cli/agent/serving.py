"""Runs a DDS-XRCE agent on one link for `msbot agent`."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import logging
import os
import sys
from collections.abc import Callable, Coroutine, Iterator, Sequence
from dataclasses import field
from datetime import datetime
from functools import partial
from pathlib import Path

import click

from msbot_agent.agent import Agent, AgentSettings, DiscoveryResponder, StatusServer, host_ipv6_addresses
from msbot_agent.cli.agent.agent_service import AgentContext, AgentPlan, AgentService
from msbot_agent.cli.command_services import WantedService
from msbot_agent.cli.logs import LogOptions
from msbot_agent.cli.until_ended import run_until_signal
from msbot_agent.link import Link, Peer, Signal, Tap, bound_name
from msbot_agent.link.net import MAX_CONNECTIONS, TcpServerLink, UdpServerLink
from msbot_agent.log import BURST
from msbot_agent.process.end_signals import run_to_end
from msbot_agent.process.nonblocking_output import nonblocking_output
from msbot_agent.process.user_folders import PACKAGES
from msbot_agent.ros.graph import RosGraph
from msbot_agent.space import MEMORY, SharedSpace, Space, SpaceAddress, open_space
from msbot_agent.text.untrusted_input import open_input_text
from msbot_xrce import References, explain
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

# Packets on the terminal: octets and their meaning (`msbot agent -v 6`).


OCTETS_A_LINE = 32


def packet_tap(link: Link, say: Callable[[str], None]) -> Tap:
    """A tap that prints every packet of a link."""

    def tap(now: float, way: str, peer: Peer, packet: bytes) -> None:  # noqa: ARG001 - prints the time of day
        say(packet_text(datetime.now(), way, link.describe(peer), packet))

    return tap


def packet_text(at: datetime, way: str, address: str, packet: bytes) -> str:
    """One packet: when, from or to whom, its octets, its meaning."""
    arrow = "from" if way == "in" else "to"
    lines = [f"{at:%H:%M:%S.%f} {arrow} {address}: {amount(len(packet), 'byte')}"]
    for start in range(0, len(packet), OCTETS_A_LINE):
        lines.append(f"    {packet[start : start + OCTETS_A_LINE].hex(' ')}")
    lines += [f"    {line}" for line in explain(packet)]
    return "\n".join(lines)


LEVELS = (
    logging.CRITICAL + 1, logging.CRITICAL, logging.ERROR, logging.WARNING, logging.INFO, logging.DEBUG, logging.DEBUG
)  # fmt: skip
"""Levels of logging by the number behind `-v`."""
SAY_HELLO = 4
SAY_DETAILS = 5
SAY_PACKETS = 6
DETAILS_IN_A_ROW = 2000
"""Lines of one kind within 10 s, for somebody who wants to see what each of many boards creates."""

DOMAIN_VARIABLE = "XRCE_DOMAIN_ID_OVERRIDE"
"""Environment variable with the domain of participants that leave the choice to the agent."""

MOST_DOMAIN = 232
"""The highest domain whose ports exist (DDSI-RTPS 2.5 §9.6.1)."""

LARGEST_FILE = 8_000_000
"""Of a file that is read whole, in characters."""

FILES_BESIDES = 64
"""Files that a process needs in addition to its connections."""


@dataclass(frozen=True, slots=True)
class ServingOptions:
    """The user's options that do not depend on the link."""

    verbose: int
    middleware: str | None
    refs: Path | None
    dead_after_s: float
    """Infinite: silent clients are kept."""
    space: SpaceAddress = field(default_factory=SpaceAddress)
    log: LogOptions = field(default_factory=LogOptions)
    max_objects: int = AgentSettings().max_objects
    """Objects that one client may have."""
    services: Sequence[WantedService] = ()
    """What runs beside it, or changes it."""


@dataclass(frozen=True, slots=True)
class Discovery:
    """Where and how clients can discover the agent."""

    port: int
    interface: str | None
    """IPv4 address of the one interface on which clients ask; None = all."""
    told: str | None = None
    """IPv6 address to announce; None = the IPv4 addresses of the interfaces, or for an agent on IPv6 all addresses."""
    ip: int = 4
    """The agent's kind of IP."""


def serve(
    link: Link,
    wishes: ServingOptions,
    discovery: Discovery | None = None,
    *,
    hint: str = "",
    open_for: Callable[[int], Link] | None = None,
) -> None:
    """Run an agent on that link until Ctrl-C or SIGTERM.

    Args:
        link: where clients come in.
        wishes: the user's options.
        discovery: where clients can discover it.
        hint: printed with its greeting.
        open_for: makes the link anew for the robot whose profile has that hash, where the link tells parts of it (CAN).

    Raises:
        ConfigError: the profile file cannot be used.
        LinkDown: the link or the discovery port cannot be opened; the text names the remedy.
    """
    # In one stream with the greeting and the packets: `MicroXRCEAgent ... > log` keeps everything, and so does this.
    # JSON stays by itself, for programs.
    stream = sys.stderr if wishes.log.is_json else sys.stdout
    wishes.log.set_up(logging.WARNING, stream, burst=DETAILS_IN_A_ROW if wishes.verbose >= SAY_DETAILS else BURST)
    logging.getLogger().setLevel(max(LEVELS[wishes.verbose], logging.WARNING))
    for package in PACKAGES:  # the details of other libraries are of no use here
        logging.getLogger(package).setLevel(LEVELS[wishes.verbose])
    wishes.log.apply()
    references = None if wishes.refs is None else read_references(wishes.refs)
    if isinstance(link, TcpServerLink):
        _allow_connections()
    with contextlib.suppress(KeyboardInterrupt), nonblocking_output():
        run_to_end(_main(link, wishes, references, discovery, hint, open_for or (lambda _: link)))


def read_references(path: Path) -> References:
    """The profiles in a file.

    Raises:
        ConfigError: it cannot be read, or a profile is wrong; the text says where.
    """
    return References.parse(given_text(path, "the profiles"), str(path))


def given_text(path: Path, what: str) -> str:
    """The text of a file that was named for `what`.

    Raises:
        ConfigError: it cannot be read.
    """
    try:
        with open_input_text(path) as file:
            text = file.read(LARGEST_FILE + 1)  # it may be a device without an end
    except OSError as error:
        raise ConfigError(f"cannot read {what} in {path}: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path} is not UTF-8 text") from error
    if len(text) > LARGEST_FILE:
        raise ConfigError(f"{path} is larger than {LARGEST_FILE:,} characters: it is no file with {what}")
    return text


def discovery_for(host: str, port: int | None) -> Discovery | None:
    """Discovery on a port for an agent that listens at that host; None without a port.

    Raises:
        ConfigError: the agent has no IPv4 address that could be announced.
    """
    if port is None:
        return None
    if host in ("0.0.0.0", "::"):
        return Discovery(port, None, ip=6 if host == "::" else 4)
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host.partition("%")[0])
    except ValueError as error:
        raise ConfigError(
            f"--discovery tells addresses, and --host {host} is a name: give the address, 0.0.0.0 or ::"
        ) from error
    if isinstance(address, ipaddress.IPv6Address):
        return Discovery(port, "127.0.0.1" if address.is_loopback else None, told=str(address), ip=6)
    return Discovery(port, str(address))


def domain_override(text: str | None) -> int:
    """The domain set in the environment; 0 if there is none.

    Raises:
        ConfigError: it is not a domain.
    """
    if not text:
        return 0
    if not (text.isascii() and text.isdigit() and int(text) <= MOST_DOMAIN):
        raise ConfigError(f"{DOMAIN_VARIABLE} is {text!r}: a domain is a number from 0 to {MOST_DOMAIN}")
    return int(text)


def _allow_connections() -> None:
    """Raise the process's limit of open files as far as allowed: each TCP connection is one."""
    try:
        import resource
    except ImportError:
        return  # not on Windows, which has no such limit
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = MAX_CONNECTIONS + FILES_BESIDES
    if soft != resource.RLIM_INFINITY and soft < wanted:
        most = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


async def _main(  # noqa: PLR0917 - what `serve` was given
    link: Link,
    wishes: ServingOptions,
    references: References | None,
    discovery: Discovery | None,
    hint: str,
    open_for: Callable[[int], Link],
) -> None:
    with open_space(wishes.space) as inner:
        space = inner
        for one in wishes.services:
            if isinstance(one.service, AgentService):
                space = one.service.space(one.wanted, space)
        where = "; ".join(filter(None, (hint, space.words)))
        if isinstance(inner, SharedSpace):
            RosGraph(inner)  # micro-ROS clients are nodes for ROS 2
        greet = partial(_greet, wishes=wishes, hint=where)
        await _run_in(space, link, wishes, references, greet, discovery, open_for)


async def _run_in(  # noqa: PLR0917 - what `_main` was given, and the space
    space: Space,
    link: Link,
    wishes: ServingOptions,
    references: References | None,
    greet: Callable[[Link, str], None],
    discovery: Discovery | None,
    open_for: Callable[[int], Link],
) -> None:
    up = asyncio.Event()

    def signalled(link: Link, signal: Signal, peer: Peer | None, reason: str, now: float) -> None:  # noqa: ARG001
        if signal is Signal.LINK_UP:
            if wishes.verbose >= SAY_HELLO and not up.is_set():
                greet(link, reason)
            up.set()

    settings = AgentSettings(
        dead_after_s=wishes.dead_after_s,
        any_text_is_a_name=wishes.middleware == "ced",
        domain_255=domain_override(os.environ.get(DOMAIN_VARIABLE)),
        max_objects=wishes.max_objects,
    )
    say = click.echo if wishes.verbose else _silent
    plan = AgentPlan(space, link, open_for, settings, references, signalled, say)
    agent, work = next(_made_by_services(wishes.services, plan), None) or _usual_agent(plan)
    if wishes.verbose >= SAY_PACKETS:
        agent.tap = packet_tap(link, click.echo)
    beside = [StatusServer(agent, what="agent", name=partial(bound_name, link)).run()]
    for one in wishes.services:
        beside += one.coroutines(AgentContext(agent, (link,), space, up, click.echo))
    if discovery is not None:
        beside.append(_answer_questions(link, up, discovery))
    await run_until_signal(work, beside=beside)


def _made_by_services(
    services: Sequence[WantedService], plan: AgentPlan
) -> Iterator[tuple[Agent, Coroutine[object, object, None]]]:
    for one in services:
        made = one.service.agent(one.wanted, plan) if isinstance(one.service, AgentService) else None
        if made is not None:
            yield made


def _usual_agent(plan: AgentPlan) -> tuple[Agent, Coroutine[object, object, None]]:
    agent = Agent(plan.space, settings=plan.settings, references=plan.references, signal=plan.on_signal)
    agent.add_link(plan.link)
    return agent, agent.run()


def _silent(words: str) -> None:
    """`-v 0` says nothing."""


async def _answer_questions(link: Link, up: asyncio.Event, discovery: Discovery) -> None:
    await up.wait()
    assert isinstance(link, UdpServerLink | TcpServerLink)
    told: Callable[[], Sequence[str]] | None = None
    if discovery.told is not None:
        told = partial(list, [discovery.told])
    elif discovery.ip == 6:
        told = host_ipv6_addresses
    await DiscoveryResponder(link.port, port=discovery.port, interface=discovery.interface, told=told).run()


def _greet(link: Link, reason: str, *, wishes: ServingOptions, hint: str) -> None:
    if isinstance(link, UdpServerLink | TcpServerLink):
        reason = ""
    words = ", ".join(filter(None, (f"agent on {bound_name(link)}", reason, hint)))
    click.echo(f"{words}; Ctrl-C ends it")
    if wishes.middleware in ("dds", "rtps") and wishes.space.kind == MEMORY:
        click.echo(f"-m {wishes.middleware}: samples stay in this process' memory; --space dds puts them into DDS")

"""Runs a DDS-XRCE agent on one link for `msbot agent`."""

from __future__ import annotations

import asyncio
import contextlib
import ipaddress
import logging
import math
import os
import platform
import sys
from collections.abc import Callable, Coroutine, Sequence
from dataclasses import field, replace
from functools import partial
from pathlib import Path

import click

from msbot.agent import Agent, AgentSettings, DiscoveryResponder, StatusServer, host_ipv6_addresses
from msbot.cli.agent.packets import packet_tap
from msbot.cli.agent.recording import AgentRecording, check_recording
from msbot.cli.run.logs import LogWishes
from msbot.cli.run.metrics import metrics_beside
from msbot.cli.run.until_ended import run_until_signal
from msbot.errors import ConfigError
from msbot.link import Link, Peer, Signal, bound_name, open_link
from msbot.link.net import MAX_CONNECTIONS, TcpServerLink, UdpServerLink
from msbot.ros.graph import RosGraph
from msbot.runtime.event_loop import run_to_end
from msbot.runtime.given_file import open_given_text
from msbot.runtime.lazy_dataclass import dataclass
from msbot.runtime.log_limiter import BURST
from msbot.runtime.patient_output import patient_output
from msbot.space import MEMORY, SharedSpace, Space, SpaceAddress, open_space
from msbot.xrce import References

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
class MasterElsewhere:
    """A master that feeds this agent's gate."""

    address: str
    name: str
    """What it calls this agent."""


def wished_master(address: str | None, name: str | None, space: SpaceAddress) -> MasterElsewhere | None:
    """What `--master` and `--name` say.

    Raises:
        ConfigError: they make no sense, or not with `--space`.
    """
    if address is None:
        if name is not None:
            raise ConfigError("--name is what a master calls this agent: say with --master ADDRESS where that is")
        return None
    if space.kind != MEMORY:
        raise ConfigError(
            "with --master the topics go to the robot's master: leave --space out here, and give it to `msbot master`"
        )
    open_link(address)  # report mistakes before anything runs
    return MasterElsewhere(address, name or platform.node() or "agent")


@dataclass(frozen=True, slots=True)
class Wishes:
    """The user's options that do not depend on the link."""

    verbose: int
    middleware: str | None
    refs: Path | None
    dead_after_s: float
    """Infinite: silent clients are kept."""
    space: SpaceAddress = field(default_factory=SpaceAddress)
    metrics_port: int | None = None
    log: LogWishes = field(default_factory=LogWishes)
    master: MasterElsewhere | None = None
    """The master that says who is let in; None: everybody is."""
    rec: Path | None = None
    """A file in which everything is recorded."""
    max_objects: int = AgentSettings().max_objects
    """Objects that one client may have."""


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
    link: Link, wishes: Wishes, discovery: Discovery | None = None, *, hint: str = "",
    open_for: Callable[[int], Link] | None = None,
) -> None:  # fmt: skip
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
    logging.getLogger("msbot").setLevel(LEVELS[wishes.verbose])  # the details of other libraries are of no use here
    wishes.log.apply()
    references = None if wishes.refs is None else read_references(wishes.refs)
    if wishes.rec is not None:
        if wishes.master is not None:
            raise ConfigError(
                "--rec is for an agent on its own; a robot is recorded by its master: `msbot master --rec`"
            )
        check_recording(wishes.rec)
    if isinstance(link, TcpServerLink):
        _allow_connections()
    with contextlib.suppress(KeyboardInterrupt), patient_output():
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
        with open_given_text(path) as file:
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
    link: Link, wishes: Wishes, references: References | None, discovery: Discovery | None, hint: str,
    open_for: Callable[[int], Link],
) -> None:  # fmt: skip
    with open_space(wishes.space) as inner:
        recording = None if wishes.rec is None else AgentRecording(wishes.rec)
        space = inner if recording is None else recording.space(inner)
        where = "; ".join(filter(None, (hint, space.words)))
        if isinstance(inner, SharedSpace):
            RosGraph(inner)  # micro-ROS clients are nodes for ROS 2
        greet = partial(_greet, wishes=wishes, hint=where)
        beside = [] if recording is None else [recording.run(link)]
        await _run_in(space, link, wishes, references, greet, discovery, open_for, beside)


async def _run_in(  # noqa: PLR0917 - what `_main` was given, and the space
    space: Space, link: Link, wishes: Wishes, references: References | None, greet: Callable[[Link, str], None],
    discovery: Discovery | None, open_for: Callable[[int], Link], more: Sequence[Coroutine[object, object, None]],
) -> None:  # fmt: skip
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
    if wishes.master is None:
        agent = Agent(space, settings=settings, references=references, signal=signalled)
        agent.add_link(link)
        work = agent.run()
    else:
        from msbot.master.fed_agent import FedAgent  # here, because an agent starts without all that a master needs

        say = click.echo if wishes.verbose else _silent
        fed = FedAgent(
            open_for, open_link(wishes.master.address), name=wishes.master.name, say=say, space=space,
            settings=fed_settings(settings), references=references, on_signal=signalled,
        )  # fmt: skip
        agent, work = fed.agent, fed.run()
        say(f"agent {wishes.master.name} looks for the robot's master on {wishes.master.address}; Ctrl-C ends it")
    if wishes.verbose >= SAY_PACKETS:
        agent.tap = packet_tap(link, click.echo)
    beside = [StatusServer(agent, what="agent", name=partial(bound_name, link)).run(), *more]
    beside += metrics_beside(wishes.metrics_port, agent, click.echo)
    if discovery is not None:
        beside.append(_answer_questions(link, up, discovery))
    await run_until_signal(work, beside=beside)


def _silent(words: str) -> None:
    """`-v 0` says nothing."""


def fed_settings(settings: AgentSettings) -> AgentSettings:
    """The same for an agent of a robot: a client that is silent is removed, as at a master."""
    if settings.dead_after_s < math.inf:
        return settings
    return replace(settings, dead_after_s=AgentSettings().dead_after_s)


async def _answer_questions(link: Link, up: asyncio.Event, discovery: Discovery) -> None:
    await up.wait()
    assert isinstance(link, UdpServerLink | TcpServerLink)
    told: Callable[[], Sequence[str]] | None = None
    if discovery.told is not None:
        told = partial(list, [discovery.told])
    elif discovery.ip == 6:
        told = host_ipv6_addresses
    await DiscoveryResponder(link.port, port=discovery.port, interface=discovery.interface, told=told).run()


def _greet(link: Link, reason: str, *, wishes: Wishes, hint: str) -> None:
    if isinstance(link, UdpServerLink | TcpServerLink):
        reason = ""
    words = ", ".join(filter(None, (f"agent on {bound_name(link)}", reason, hint)))
    click.echo(f"{words}; Ctrl-C ends it")
    if wishes.middleware in ("dds", "rtps") and wishes.space.kind == MEMORY:
        click.echo(f"-m {wishes.middleware}: samples stay in this process' memory; --space dds puts them into DDS")

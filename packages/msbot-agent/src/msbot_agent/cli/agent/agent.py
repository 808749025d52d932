"""`msbot agent`: a DDS-XRCE agent for any client; its options are those of eProsima's MicroXRCEAgent."""

from __future__ import annotations

import ipaddress
import math
from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from pathlib import Path

import click

from msbot_agent.agent import MOST_OBJECTS, AgentSettings
from msbot_agent.cli.agent.agent_service import AgentCommand
from msbot_agent.cli.agent.serving import ServingOptions, discovery_for, given_text, serve
from msbot_agent.cli.command_services import wanted_services
from msbot_agent.cli.logs import LogOptions, log_options
from msbot_agent.cli.options import FiniteRange, WholeRange, space_option
from msbot_agent.link import Link, open_link
from msbot_agent.link.can import CanSettings, Codec
from msbot_agent.link.net import TcpServerLink, UdpServerLink
from msbot_agent.link.serial import PtyServerLink, SerialServerLink
from msbot_agent.space import SpaceAddress
from msbot_xrce import compress, decompress, is_whole
from msbot_xrce.errors import ConfigError

DISCOVERY_PORT = 7400
DEFAULT_VERBOSE = 4
AUTO = "auto"

LOCAL_ONLY = "for this computer only (--host {everywhere} serves boards in the network)"

Command = Callable[..., None]


@click.group("agent")
def command() -> None:
    """Run a DDS-XRCE agent that serves every client: micro-ROS boards, eProsima programs, MsBOT parts.

    Every client is let in; what it creates is in this process's memory, or with --space dds in DDS. With --master,
    clients are parts of a robot whose master runs elsewhere and decides who is let in. The other options are
    those of MicroXRCEAgent.
    """


def common_options(function: Command) -> Command:
    """The options of every kind of agent, passed on as `wishes`."""

    @click.option(
        "-m",
        "--middleware",
        type=click.Choice(["ced", "dds", "rtps"]),
        help="ced: any reference or XML is taken as the topic's name. dds and rtps are accepted from start scripts "
        "and have no effect: --space says where topics are.",
    )
    @space_option
    @log_options
    @click.option(
        "-r",
        "--refs",
        metavar="FILE",
        type=click.Path(path_type=Path),
        help="Profiles (XML) for clients that create objects by reference.",
    )
    @click.option(
        "-v",
        "--verbose",
        type=WholeRange(0, 6),
        is_flag=False,
        flag_value=DEFAULT_VERBOSE,
        default=DEFAULT_VERBOSE,
        show_default=True,
        help="0 nothing, 2 errors, 4 clients that come and go, 5 also what each creates, deletes and reads, 6 every "
        "packet.",
    )
    @click.option(
        "--dead-after",
        metavar="SECONDS",
        type=FiniteRange(min=0.1),
        help="Silence after which a client is probed three times, then removed; by default silent clients stay, "
        "unless they set it themselves (uxr_hl).",
    )
    @click.option(
        "--max-objects",
        metavar="N",
        type=WholeRange(1, MOST_OBJECTS),
        default=AgentSettings().max_objects,
        show_default=True,
        help="Objects that one client may have: participants, topics, publishers, writers ...",
    )
    @wraps(function)
    def wrapped(
        *,
        middleware: str | None,
        space: SpaceAddress,
        log_wishes: LogOptions,
        refs: Path | None,
        verbose: int,
        dead_after: float | None,
        max_objects: int,
        **others: object,
    ) -> None:
        function(
            wishes=ServingOptions(
                verbose,
                middleware,
                refs,
                math.inf if dead_after is None else dead_after,
                space,
                log_wishes,
                max_objects,
                wanted_services(),
            ),
            **others,
        )

    return wrapped


def network_command(name: str, kind: type[UdpServerLink] | type[TcpServerLink], *, ip: int, doc: str) -> None:
    """Add the command for a transport over IP."""
    here, everywhere = ("127.0.0.1", "0.0.0.0") if ip == 4 else ("::1", "::")

    @command.command(name, cls=AgentCommand, help=doc)
    @click.option("-p", "--port", type=WholeRange(0, 65535), required=True, help="Port to listen on; 0 = any.")
    @click.option(
        "--host", default=here, show_default=True, help=f"Address to listen on; {everywhere} for every interface."
    )
    @click.option(
        "-d",
        "--discovery",
        metavar="[PORT]",
        type=WholeRange(1, 65535),
        is_flag=False,
        flag_value=DISCOVERY_PORT,
        help="Answer clients that look for an agent by multicast; default port: 7400.",
    )
    @common_options
    def run(*, port: int, host: str, discovery: int | None, wishes: ServingOptions) -> None:
        check_host(host, ip=ip, name=name)
        where = discovery_for(host, discovery)
        hint = LOCAL_ONLY.format(everywhere=everywhere) if host == here else ""
        if hint and where is not None:
            hint += "; discovery answers this computer only, too"
        serve(kind(host, port), wishes, where, hint=hint)


def check_host(host: str, *, ip: int, name: str) -> None:
    """Make sure that an address is one of the command's kind of IP; names may be either.

    Raises:
        ConfigError: it is empty, or an address of the other kind.
    """
    if not host.strip():
        raise ConfigError("--host is empty: leave it out, or give an address, such as 192.168.1.20")
    try:
        version = ipaddress.ip_address(host.partition("%")[0]).version
    except ValueError:
        return
    if version != ip:
        other = name.replace(str(ip), str(version))
        raise ConfigError(f"--host {host} is an address of IPv{version}: use `msbot agent {other}`")


network_command("udp4", UdpServerLink, ip=4, doc="Serve clients over UDP and IPv4.")
network_command("udp6", UdpServerLink, ip=6, doc="Serve clients over UDP and IPv6.")
network_command("tcp4", TcpServerLink, ip=4, doc="Serve clients over TCP and IPv4.")
network_command("tcp6", TcpServerLink, ip=6, doc="Serve clients over TCP and IPv6.")

baudrate_option = click.option(
    "-b", "--baudrate", type=WholeRange(), default=115_200, show_default=True, help="Bits per second."
)


def port_options(function: Command) -> Command:
    """The options of both serial commands, passed on as `link`."""

    @click.option(
        "-D",
        "--dev",
        "--devs",
        "ports",
        metavar="PORT",
        multiple=True,
        help=f"Serial port, for example /dev/ttyUSB0; {AUTO} = every USB serial port.",
    )
    @click.option(
        "-f",
        "--file",
        "list_file",
        metavar="FILE",
        type=click.Path(path_type=Path),
        help="A file with the ports' names, one per line, instead of --dev.",
    )
    @click.option("-fc", "--flow-control", is_flag=True, help="Use RTS/CTS flow control.")
    @baudrate_option
    @wraps(function)
    def wrapped(
        *, ports: tuple[str, ...], list_file: Path | None, flow_control: bool, baudrate: int, **others: object
    ) -> None:
        names = port_names(ports, list_file)
        function(ports=names, link=serial_link(names, baudrate, flow_control=flow_control), **others)

    return wrapped


def serial_link(names: list[str], baudrate: int, *, flow_control: bool) -> Link:
    """The link for ports by name."""
    return SerialServerLink([] if names == [AUTO] else names, baudrate=baudrate, flow_control=flow_control)


def port_names(ports: tuple[str, ...], list_file: Path | None) -> list[str]:
    """The ports that were named, on the command line or in a file.

    Raises:
        ConfigError: neither or both were given, or the file cannot be read.
    """
    if bool(ports) == bool(list_file):
        raise ConfigError(f"name the serial ports with --dev or in a --file, one of the two; --dev {AUTO} takes all")
    text = " ".join(ports)
    if list_file is not None:
        text = given_text(list_file, "the names of serial ports")
    names = text.replace(",", " ").split()
    if not names:
        raise ConfigError("no serial port is named: `ls /dev/serial/by-id` shows what is plugged in")
    if AUTO in names and names != [AUTO]:
        raise ConfigError(f"--dev {AUTO} takes every serial port: name no other beside it")
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        raise ConfigError(f"{', '.join(twice)}: a serial port is opened once, name it once")
    return names


@command.command("serial", cls=AgentCommand)
@port_options
@common_options
def serial(*, ports: list[str], link: Link, wishes: ServingOptions) -> None:
    """Serve the clients on one serial port, whenever it is plugged in (or on all, with --dev auto)."""
    if len(ports) > 1:
        raise ConfigError(f"{len(ports)} serial ports are named: use `msbot agent multiserial`")
    serve(link, wishes)


@command.command("multiserial", cls=AgentCommand)
@port_options
@common_options
def multiserial(*, ports: list[str], link: Link, wishes: ServingOptions) -> None:  # noqa: ARG001 - any number of ports is right
    """Serve the clients on several serial ports, whenever they are plugged in."""
    serve(link, wishes)


@command.command("pseudoterminal", cls=AgentCommand)
@click.option("-D", "--dev", "path", metavar="NAME", help="A name for the terminal, besides the one the system gives.")
@baudrate_option
@common_options
def pseudoterminal(*, path: str | None, baudrate: int, wishes: ServingOptions) -> None:  # noqa: ARG001 - nothing slows it down
    """Serve clients on this computer that want a serial port: makes a pseudo terminal and prints its path."""
    if path is not None and not path.strip():
        raise ConfigError("--dev is empty: leave it out, or give the terminal a name, such as /tmp/robot.tty")
    serve(PtyServerLink(path), wishes)


def id_option(function: Command) -> Command:
    """`-I`, which eProsima's agent accepts for `canfd` and ignores."""

    @click.option(
        "-I",
        "--id",
        "can_id",
        metavar="ID",
        help="Accepted from start scripts, without effect: each client is answered with its own.",
    )
    @wraps(function)
    def wrapped(*, can_id: str | None, **others: object) -> None:  # noqa: ARG001 - nothing depends on it
        function(**others)

    return wrapped


def can_command(name: str, *, doc: str, extra: Callable[[Command], Command] = lambda function: function) -> None:
    """Add the command for one framing on a CAN bus; `extra` is an option of its own."""

    @command.command(name, cls=AgentCommand, help=doc)
    @extra
    @click.option(
        "-D",
        "--dev",
        "device",
        metavar="BUS",
        required=True,
        help="An interface of Linux (can0), or an interface of python-can and its channel "
        "(slcan:/dev/ttyACM0?bitrate=500000); can takes a simulated bus, too (sim:classroom).",
    )
    @common_options
    def run(*, device: str, wishes: ServingOptions) -> None:
        settings = CanSettings(codec=Codec(compress, decompress), is_whole=is_whole)

        def open_bus(profile_hash: int) -> Link:
            address = device if name == "can" and device.startswith("sim:") else f"{name}:{device}"
            return open_link(address, serve=True, can=replace(settings, profile_hash=profile_hash))

        serve(open_bus(0), wishes, open_for=open_bus)


can_command("can", doc="Serve parts of MsBOT on a CAN bus, classic or FD (?fd=1); up to 120 of them.")
can_command("canfd", doc="Serve eProsima's clients on a CAN FD bus: one frame is one packet.", extra=id_option)
can_command("can-legacy", doc="Serve one part with the thesis' firmware on a classic CAN bus.")

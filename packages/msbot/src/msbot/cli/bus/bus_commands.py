"""`msbot bus`: tools for people who look at a CAN bus."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import click

from msbot.cli.bus.dump import FilterType, FrameFilter
from msbot.cli.bus.frame_log import FrameReader
from msbot.cli.bus.frame_words import WordsFormat, tell_unknown, told_lines
from msbot.cli.database_place import DEFAULT_BLUEPRINT
from msbot.cli.robot_options import library_option
from msbot.pnp import FrameListener
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.group import complain
from msbot_agent.cli.options import FiniteRange, WholeRange, json_option
from msbot_agent.link.can.sim import DEFAULT_NAME

_C = TypeVar("_C", bound=Callable[..., object])

MOST_BYTES = 65_535
"""Largest sample for which a forecast is made."""


@click.group("bus")
def command() -> None:
    """Tools for a CAN bus: watch it, send frames, count their bits, measure or predict the load, simulate a bus."""


bitrate_option = click.option(
    "--bitrate", type=WholeRange(min=1), default=500_000, show_default=True, help="Nominal bit rate, bit/s."
)
data_bitrate_option = click.option(
    "--data-bitrate",
    type=WholeRange(min=1),
    default=2_000_000,
    show_default=True,
    help="Bit rate of the data phase of CAN FD frames with a bit-rate switch, bit/s.",
)


def words_options(function: _C) -> _C:
    """The options of the commands that say what frames mean."""
    legacy = click.option(
        "--legacy", is_flag=True, help="The frames are those of the thesis' firmware (0x123 up, 0x120 down)."
    )
    blueprint = click.option(
        "--blueprint",
        type=click.Path(exists=True, dir_okay=False, path_type=Path),
        help="The robot's blueprint; the robot.toml here, if there is one.",
    )
    protocol = click.option(
        "--protocol", is_flag=True, help="If the robot is known: also the protocol, below each sentence."
    )
    as_json = click.option(
        "--json", "as_json", is_flag=True, help="Print a JSON object for each frame, with plain and protocol."
    )
    return legacy(blueprint(library_option(protocol(as_json(function)))))


@command.command("cost")
@click.argument("frames", metavar="FRAME...", nargs=-1, required=True)
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list of frame, nominal_bits and data_bits.")
@bitrate_option
@data_bitrate_option
def cost(frames: tuple[str, ...], bitrate: int, data_bitrate: int, *, as_json: bool) -> None:
    """Count the bits of each FRAME on the wire, stuff bits and intermission included.

    A FRAME is written as in can-utils: 123#DEADBEEF, 1ABCDEF0#11.22 (extended), 123#R4 (remote), 123##1DEADBEEF
    (CAN FD; 1 = bit-rate switch, 2 = ESI). Data that fits no length of CAN FD is padded with CC.
    """
    from msbot.cli.bus.load import cost_json, cost_table

    click.echo(cost_json(frames) if as_json else cost_table(frames, bitrate, data_bitrate))


@command.command("decode")
@click.argument("log", default="-")
@words_options
def decode(
    log: str, *, legacy: bool, blueprint: Path | None, folders: tuple[Path, ...], protocol: bool, as_json: bool
) -> None:
    """Show each frame of a log with its meaning: segment, DDS-XRCE message, fields, sample.

    If the robot is known (--blueprint, or the robot.toml here), in sentences: knob says level 49.9 %.

    LOG is a file of `candump -l` or `msbot demo --log`; without it, what candump shows is read from standard input:
    candump can0 | msbot bus decode. Files ending in .asc, .blf or .trc are read by python-can.
    """
    from msbot.cli.bus.frame_words import library_of, listener_for, words_format

    library = library_of(blueprint, folders, complain)
    manner = words_format(is_known=library is not None, protocol=protocol, as_json=as_json)
    decode_log(log, listener_for(library, legacy=legacy), manner, click.echo, complain)


class SizeType(click.ParamType[tuple[str, int]]):
    """`LightLevel=12`."""

    name = "TYPE=BYTES"

    def convert(
        self, value: str | tuple[str, int], param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, int]:
        """The type and the size of its samples."""
        if isinstance(value, tuple):
            return value
        type_name, _, size = value.rpartition("=")
        if not type_name or not (size.isascii() and size.isdigit()) or int(size) > MOST_BYTES:
            self.fail(f"{value!r}: write TYPE=BYTES, for example LightLevel=12", param, ctx)
        return type_name, int(size)


@command.command("dump")
@click.argument("bus", default=f"sim:{DEFAULT_NAME}", metavar="[BUS]")
@click.option("--decode/--no-decode", default=True, show_default=True, help="Say what the frames mean.")
@words_options
@click.option(
    "--log",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Also write the frames to this file; its extension gives the format.",
)
@click.option(
    "--filter",
    "filters",
    type=FilterType(),
    multiple=True,
    metavar="FILTER",
    help="Show only ID, ID:MASK, all but ID~MASK (hexadecimal), or node=N; repeatable.",
)
@click.option("--count", type=WholeRange(min=1), help="End after that many frames.")
def dump(
    *,
    bus: str,
    decode: bool,
    legacy: bool,
    blueprint: Path | None,
    folders: tuple[Path, ...],
    protocol: bool,
    as_json: bool,
    log: Path | None,
    filters: tuple[tuple[FrameFilter, ...], ...],
    count: int | None,
) -> None:
    """Show each frame of a live bus or log with its meaning: segment, DDS-XRCE message, sample.

    If the robot is known (its master runs on this computer, --blueprint, or the robot.toml here), in sentences: knob
    says level 49.9 %.

    BUS is can0, an address (can:slcan:/dev/ttyACM0?bitrate=500000, sim:classroom), a log (.log of candump, .asc, .blf,
    .trc, .csv, .db, .mf4), or - for what candump shows. A live bus is shown until Ctrl-C.
    """
    from msbot.cli.bus.bus_source import is_log
    from msbot.cli.bus.dump import DumpOptions, Understanding, dump
    from msbot.cli.bus.frame_words import library_of, listener_for, words_format

    library = library_of(blueprint, folders, complain)
    asks = decode and not legacy and not is_log(bus)  # whose robot a log is, no master can say

    def understand() -> Understanding:
        from msbot.cli.bus.bus_source import robot_on_bus

        robot = robot_on_bus(bus, complain) if asks else None
        is_known = library is not None or robot is not None
        return Understanding(
            listener_for(library, legacy=legacy, robot=robot),
            words_format(is_known=is_known, protocol=protocol, as_json=as_json),
        )

    wishes = DumpOptions(decode, log, tuple(wish for option in filters for wish in option), count)
    dump(bus, wishes, understand, click.echo, complain)


@command.command("send")
@click.argument("bus")
@click.argument("frames", metavar="FRAME...", nargs=-1, required=True)
@click.option("--repeat", type=WholeRange(min=1), default=1, show_default=True, help="How often to send them.")
@click.option(
    "--period", type=FiniteRange(min=0.0), default=1.0, show_default=True, help="Seconds between repetitions."
)
def send(bus: str, frames: tuple[str, ...], repeat: int, period: float) -> None:
    """Send frames; status 2 if nobody acknowledges within 2 s.

    A FRAME is written as in can-utils: 123#DEADBEEF, 1ABCDEF0#11.22 (extended), 123#R4 (remote), 123##1DEADBEEF
    (CAN FD; 1 = bit-rate switch, 2 = ESI). BUS is can0 or an address, such as sim:classroom.
    """
    from msbot.cli.bus.send import send

    send(bus, frames, repeat, period, complain)


@command.command("serve")
@click.argument("name", default=DEFAULT_NAME)
@click.option(
    "--bitrate", type=WholeRange(10_000, 1_000_000), default=500_000, show_default=True, help="Nominal bit rate, bit/s."
)
@click.option("--fd", is_flag=True, help="A CAN FD bus, with bit-rate switch.")
@click.option(
    "--data-bitrate",
    type=WholeRange(10_000, 8_000_000),
    default=2_000_000,
    show_default=True,
    help="Bit rate of the data phase of CAN FD, bit/s.",
)
def serve(name: str, bitrate: int, data_bitrate: int, *, fd: bool) -> None:
    """Serve a simulated CAN bus to programs of this user until Ctrl-C.

    MsBOT's own programs join it as sim:NAME, those of python-can as interface msbot, channel NAME.
    """
    from msbot.cli.bus.send import serve

    serve(name, bitrate, data_bitrate if fd else None)


@command.command("load")
@click.argument("what", metavar="[BLUEPRINT|BUS]", default=str(DEFAULT_BLUEPRINT))
@bitrate_option
@data_bitrate_option
@click.option("--fd", is_flag=True, help="Forecast: CAN FD with bit-rate switch.")
@click.option("--no-compression", is_flag=True, help="Forecast: DDS-XRCE headers as they are.")
@click.option(
    "--size", "sizes", type=SizeType(), multiple=True, help="Forecast: bytes of a sample of that type; repeatable."
)
@click.option(
    "--library",
    "folders",
    type=click.Path(path_type=Path),
    multiple=True,
    help="Forecast: a folder with more part types.",
)
@click.option("--seconds", type=WholeRange(min=1), help="Live bus: end after so many seconds.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object (live bus: one for each second).")
def load(
    *,
    what: str,
    bitrate: int,
    data_bitrate: int,
    fd: bool,
    no_compression: bool,
    sizes: tuple[tuple[str, int], ...],
    folders: tuple[Path, ...],
    seconds: int | None,
    as_json: bool,
) -> None:
    """Measure the load of a live BUS, or predict it for a BLUEPRINT (robot.toml).

    A BUS is can0 or an address, such as sim:classroom; its frames are counted bit by bit, each second, by identifier.

    A forecast counts BEACON, the beats and the samples of every binding whose port has a rate_hz, bit by bit;
    joining, set-up and losses are left out.
    """
    from msbot.cli.bus.bus_source import is_bus

    if is_bus(what):
        from msbot.cli.bus.load import show_load

        show_load(
            what,
            bitrate=bitrate,
            data_bitrate=data_bitrate,
            seconds=seconds,
            as_json=as_json,
            say=click.echo,
            complain=complain,
        )
        return
    from msbot.cli.bus.load import Bus, load_report

    bus = Bus(bitrate, data_bitrate, fd, not no_compression)
    click.echo(load_report(Path(what), folders, bus, dict(sizes), as_json=as_json))


@command.command("selftest")
@click.option(
    "--bitrate",
    type=WholeRange(10_000, 1_000_000),
    default=500_000,
    show_default=True,
    help="Bit rate of the bus, bit/s.",
)
@click.option("--frames", type=WholeRange(1, 100_000), default=1000, show_default=True, help="Frames per check.")
@json_option
def selftest(bitrate: int, frames: int, *, as_json: bool) -> None:
    """Run the thesis' bus checks T1 to T4 with two controllers on the simulated bus.

    Ends with status 1 if a check fails.
    """
    from msbot.cli.bus.selftest import run_selftest

    if not run_selftest(bitrate, frames, click.echo, as_json=as_json):
        raise SystemExit(ExitStatus.NO)


# What the frames of a log say: `msbot bus decode`.


def decode_log(
    name: str, listener: FrameListener, manner: WordsFormat, say: Callable[[str], None], complain: Callable[[str], None]
) -> None:
    """Print every frame of a log with its meaning; what could not be read is reported at the end.

    Args:
        name: the file, or `-` for standard input.
        listener: understands the frames.
        manner: what is said of them.
        say: takes a line of the answer.
        complain: takes what is wrong with the log.

    Raises:
        ConfigError: the log cannot be read.
    """
    reader = FrameReader()
    for line in reader.read(name):
        for text in told_lines(line, listener.explain_frame(line.frame, line.at or 0.0), manner):
            say(text)
    tell_unknown(listener, manner, complain)
    reader.tell(name, complain)

"""`msbot bus`: tools for people who look at a CAN bus."""

from __future__ import annotations

from pathlib import Path

import click

from msbot.cli.options import DEFAULT_BLUEPRINT

MOST_BYTES = 65_535
"""Largest sample a forecast is made for."""


@click.group("bus")
def command() -> None:
    """Tools for a CAN bus: decode a log, count the bits of frames, foretell the load, check the way."""


bitrate_option = click.option(
    "--bitrate", type=click.IntRange(min=1), default=500_000, show_default=True, help="Nominal bit rate, bit/s."
)
data_bitrate_option = click.option(
    "--data-bitrate", type=click.IntRange(min=1), default=2_000_000, show_default=True,
    help="Bit rate of the data phase of CAN FD frames with a bit-rate switch, bit/s.",
)  # fmt: skip


@command.command("cost")
@click.argument("frames", metavar="FRAME...", nargs=-1, required=True)
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list of frame, nominal_bits and data_bits.")
@bitrate_option
@data_bitrate_option
def cost(frames: tuple[str, ...], bitrate: int, data_bitrate: int, *, as_json: bool) -> None:
    """Say how many bits each FRAME takes on the wire, stuff bits and the 3 bits of intermission included.

    A FRAME is written as in can-utils: 123#DEADBEEF, 1ABCDEF0#11.22 (extended), 123#R4 (remote), 123##1DEADBEEF
    (CAN FD; 1 = bit-rate switch, 2 = ESI). Data that fits no length of CAN FD is padded with CC.
    """
    from msbot.cli.bus_cost import cost_json, cost_table

    click.echo(cost_json(frames) if as_json else cost_table(frames, bitrate, data_bitrate))


@command.command("decode")
@click.argument("log", default="-")
@click.option("--legacy", is_flag=True, help="The frames are those of the thesis' firmware (0x123 up, 0x120 down).")
def decode(log: str, *, legacy: bool) -> None:
    """Show every frame of LOG with what it says: segment, DDS-XRCE message, fields, the sample in it.

    LOG is a file of `candump -l` or `msbot demo --log`; without it, what candump shows is read from standard input:
    candump can0 | msbot bus decode. Files ending in .asc, .blf or .trc are read by python-can.
    """
    from msbot.cli.bus_decode import complain, decode_log

    decode_log(log, click.echo, complain, legacy=legacy)


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


@command.command("load")
@click.argument("blueprint", type=click.Path(path_type=Path), default=DEFAULT_BLUEPRINT)
@bitrate_option
@data_bitrate_option
@click.option("--fd", is_flag=True, help="CAN FD with bit-rate switch.")
@click.option("--no-compression", is_flag=True, help="DDS-XRCE headers as they are.")
@click.option("--size", "sizes", type=SizeType(), multiple=True, help="Bytes of a sample of that type; repeatable.")
@click.option(
    "--library", "folders", type=click.Path(path_type=Path), multiple=True, help="A folder with more part types."
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def load(
    *, blueprint: Path, bitrate: int, data_bitrate: int, fd: bool, no_compression: bool,
    sizes: tuple[tuple[str, int], ...], folders: tuple[Path, ...], as_json: bool,
) -> None:  # fmt: skip
    """Foretell how busy a CAN bus is with the robot that BLUEPRINT (robot.toml) describes.

    Counted are BEACON, the beats and the samples of every binding whose port has a rate_hz, bit by bit; what happens
    only sometimes (joining, set-up, losses) is not.
    """
    from msbot.cli.bus_load import Bus, load_report

    bus = Bus(bitrate, data_bitrate, fd, not no_compression)
    click.echo(load_report(blueprint, folders, bus, dict(sizes), as_json=as_json))


@command.command("selftest")
@click.option("--bitrate", type=click.IntRange(10_000, 1_000_000), default=500_000, show_default=True,
              help="Bit rate of the bus, bit/s.")  # fmt: skip
@click.option("--frames", type=click.IntRange(1, 100_000), default=1000, show_default=True, help="Frames for a check.")
def selftest(bitrate: int, frames: int) -> None:
    """Check the way from controller to controller on the simulated bus, as the thesis did first (T1 to T4).

    Ends with status 1 if a check fails.
    """
    from msbot.cli.bus_selftest import run_selftest

    if not run_selftest(bitrate, frames, click.echo):
        raise SystemExit(1)

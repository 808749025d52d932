"""`msbot bus`: tools for people who look at a CAN bus."""

from __future__ import annotations

import click


@click.group("bus")
def command() -> None:
    """Tools for a CAN bus: what frames cost and what they say."""


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

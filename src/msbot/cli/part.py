"""`msbot part`: one simulated part of the sample robot in a process of its own."""

from __future__ import annotations

import click

from msbot.cli.options import DEFAULT_LINK
from msbot.errors import ConfigError
from msbot.part import SAMPLE_PARTS, SimGpio, make_sample, run


@click.command("part")
@click.argument("name")
@click.option("--link", default=DEFAULT_LINK, show_default=True, envvar="MSBOT_LINK", show_envvar=True,
              help="The way to the master.")  # fmt: skip
@click.option("--uid", help="16 hexadecimal digits; drawn once and kept on this computer unless given.")
@click.option("-q", "--quiet", is_flag=True, help="Say only what is wrong.")
def command(name: str, link: str, uid: str | None, *, quiet: bool) -> None:
    """Run the part NAME of the sample robot: AA, BB or CC, or its part number ABCD, EFGH or WXYZ.

    It recognises its robot, registers, beats, and plays its role in the ring until Ctrl-C.
    """
    numbers = {sample.part_number: key for key, sample in SAMPLE_PARTS.items()}
    key = numbers.get(name, name)
    if key not in SAMPLE_PARTS:
        known = ", ".join(f"{key} ({sample.part_number})" for key, sample in SAMPLE_PARTS.items())
        raise ConfigError(
            f"there is no sample part {name!r}; there are {known}. Your own parts are Python programs: see the tutorial"
        )
    board = SimGpio()
    if not quiet:
        board.on_change(lambda pin, level: click.echo(f"output {pin} is {'on' if level else 'off'}"))
    arguments = ["--link", link]
    if uid is not None:
        arguments += ["--uid", uid]
    if quiet:
        arguments.append("--quiet")
    run(make_sample(key, board=board), args=arguments)

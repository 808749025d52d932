"""`msbot part`: one simulated part in a process of its own."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from msbot.cli.options import DEFAULT_LINK, library_here, library_option
from msbot.errors import ConfigError
from msbot.part import Part, SimGpio, run
from msbot.part.sample_parts import SAMPLE_PARTS, make_sample


@click.command("part")
@click.argument("name")
@click.option("--set", "settings", metavar="CONTROL=VALUE", multiple=True,
              help="Do something to the simulated thing before it starts; may be given several times.")  # fmt: skip
@click.option("--name", "local_name", metavar="LOCAL",
              help="What this one is called; the part number if absent.")  # fmt: skip
@click.option("--link", default=DEFAULT_LINK, show_default=True, envvar="MSBOT_LINK", show_envvar=True,
              help="The way to the master.")  # fmt: skip
@click.option("--uid", help="16 hexadecimal digits; drawn once and kept on this computer unless given.")
@click.option("--key", help="File with the part's key, or the key itself; $MSBOT_KEY unless given.")
@library_option
@click.option("-q", "--quiet", is_flag=True, help="Say only what is wrong.")
def command(
    name: str,
    *,
    settings: tuple[str, ...],
    local_name: str | None,
    link: str,
    uid: str | None,
    key: str | None,
    folders: tuple[Path, ...],
    quiet: bool,
) -> None:
    """Run a simulated part until Ctrl-C: any part number of the library, or AA, BB or CC of the sample robot.

    It recognises its robot, registers, beats and does its work. While it runs, type CONTROL=VALUE to do something to
    it, for example press=true at a BUTTON; `msbot library show NUMBER` lists what there is.
    """
    if name in SAMPLE_PARTS:
        if settings or local_name is not None:
            raise ConfigError(
                f"{name} is a part of the sample robot and has no controls and one name; run its part number instead: "
                f"msbot part {SAMPLE_PARTS[name].part_number}"
            )
        part = _sample(name, quiet=quiet)
    else:
        part = _simulated(name, settings, local_name, folders, quiet=quiet)
    arguments = ["--link", link]
    if uid is not None:
        arguments += ["--uid", uid]
    if key is not None:
        arguments += ["--key", key]
    if quiet:
        arguments.append("--quiet")
    run(part, args=arguments)


def _sample(name: str, *, quiet: bool) -> Part:
    board = SimGpio()
    if not quiet:
        board.on_change(lambda pin, level: click.echo(f"output {pin} is {'on' if level else 'off'}"))
    return make_sample(name, board=board)


def _simulated(
    number: str, settings: tuple[str, ...], local_name: str | None, folders: tuple[Path, ...], *, quiet: bool
) -> Part:
    from msbot.cli.run.part_console import PartConsole, apply_settings, controls_words
    from msbot.sim import make_simulator

    simulated = make_simulator(number, local_name=local_name, library=library_here(folders))
    apply_settings(simulated, settings)
    if not quiet:
        PartConsole(simulated, click.echo, sys.stdin)
        click.echo(f"{simulated.part_type.name}; {controls_words(simulated)}")
    return simulated.part

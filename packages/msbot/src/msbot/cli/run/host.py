"""`msbot host`: the parts that are wired to this computer, many in one process."""

from __future__ import annotations

import contextlib
import json
import logging
import sys
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import click

from msbot.cli.robot_options import library_here, library_option, link_option
from msbot.cli.run.world_options import WorldOptions, place_option, remote_world, world_option
from msbot.part import Part
from msbot.part.join.part_keys import given_key
from msbot.part.join.uid import parse_uid, stored_uid
from msbot.part.run import CAN
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.group import complain
from msbot_agent.cli.options import json_option
from msbot_agent.link import Link, open_link
from msbot_agent.log import TerminalHandler
from msbot_agent.process.end_signals import on_end_signal, run_to_end
from msbot_agent.process.nonblocking_output import nonblocking_output
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Coroutine

    from msbot.hardware import HostedPart


@click.command("host")
@click.argument("path", metavar="[FILE]", type=click.Path(path_type=Path), default=Path("parts.toml"))
@link_option
@click.option("--check", is_flag=True, help="Only read the file and say what is in it; touch no hardware.")
@world_option
@place_option
@json_option
@library_option
@click.option("-q", "--quiet", is_flag=True, help="Print only problems.")
def host_command(
    path: Path,
    *,
    link: str,
    check: bool,
    world: str | None,
    place: str | None,
    as_json: bool,
    folders: tuple[Path, ...],
    quiet: bool,
) -> None:
    """Run the parts that are wired to this computer, until Ctrl-C: those of FILE, parts.toml unless named.

    Each table [[part]] of FILE is one part, real or simulated. FILE may be changed at any time: only changed parts
    restart.
    """
    from msbot.hardware import PartsHost, read_parts

    if as_json and not check:
        raise ConfigError("--json tells what --check finds: write `msbot host --check --json`")
    WorldOptions(world, place).check()
    door = None if world is None else remote_world(world, place, click.echo)
    library = library_here(folders)
    parts = read_parts(path, library)
    if as_json:
        click.echo(json.dumps([_as_json(part) for part in parts]))
        return
    if check:
        for part in parts:
            words = "simulated" if part.wiring is None else part.wiring.describe()
            click.echo(f"{part.name}: {part.part_type.name} ({part.number}), {words}")
        return

    def make() -> tuple[Endable, Coroutine[object, object, None]]:
        host = PartsHost(
            path,
            library,
            lambda part: connect(part, link),
            prepare=lambda part, hosted: identify(part, key=hosted.key or None),
            door=door,
        )
        return host, host.run()

    run_until_told(make, quiet=quiet)


def _as_json(part: HostedPart) -> dict[str, object]:
    wiring = None if part.wiring is None else part.wiring.describe()
    return {"name": part.name, "part_number": part.number, "type": part.part_type.name, "wiring": wiring}


# `msbot hardware`: what is plugged into this computer.


@click.group("hardware")
def hardware_command() -> None:
    """The hardware of this computer."""


@hardware_command.command("scan")
@library_option
@json_option
def scan_command(folders: tuple[Path, ...], *, as_json: bool) -> None:
    """Find chips, USB modules, thermometers, converters and CAN interfaces, and show how each becomes a part."""
    from msbot.hardware import Machine, scan

    result = scan(Machine(), library_here(folders))
    if as_json:
        click.echo(json.dumps(asdict(result), ensure_ascii=False))
    else:
        for thing in result.found:
            click.echo(f"{thing.where}: {thing.words}")
            for line in thing.lines:
                click.echo(f"    {line}")
        for fault in result.faults:
            complain(fault)
        if not result.found and not result.faults:
            click.echo("Nothing is plugged in that can be found: parts at plain pins do not answer.")
    sys.exit(ExitStatus.NO if result.faults else ExitStatus.DONE)


# How a command runs parts that are wired to this computer: links, UIDs, keys, signals.


class Endable(Protocol):
    """Something that runs until it is told to end."""

    def end(self) -> None:
        """End cleanly."""


def connect(part: Part, link: str) -> Link:
    """A link for one part."""
    return open_link(link, can=replace(CAN, uid=part.uid))


def identify(part: Part, *, uid: str | None = None, key: str | None = None) -> None:
    """Give a part its UID and its key: those given, or those kept on this computer.

    Raises:
        ConfigError: one of them is malformed.
    """
    part.uid = stored_uid(part.part_number, part.local_name) if uid is None else parse_uid(uid)
    part.key = given_key(key, part.part_number, part.local_name)


def run_until_told(make: Callable[[], tuple[Endable, Coroutine[object, object, None]]], *, quiet: bool) -> None:
    """Run what `make` returns, on a loop of its own, until it ends or a signal ends it cleanly.

    Args:
        make: called on the loop; returns what to tell to end, and what to run.
        quiet: print only what is wrong.
    """
    logging.basicConfig(level=logging.WARNING if quiet else logging.INFO, handlers=[TerminalHandler()])

    async def main() -> None:
        unit, work = make()
        on_end_signal(unit.end)
        await work

    with contextlib.suppress(KeyboardInterrupt), nonblocking_output():
        run_to_end(main())

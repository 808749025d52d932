"""`msbot host`: the parts that are wired to this computer, many in one process."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from msbot.cli.robot_options import library_here, library_option, link_option
from msbot.cli.run.world import WorldWishes, guest_door, place_option, world_option
from msbot_agent.cli.options import json_option
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Coroutine

    from msbot.cli.run.hosting import Endable
    from msbot.hardware import HostedPart


@click.command("host")
@click.argument("path", metavar="[FILE]", type=click.Path(path_type=Path), default=Path("parts.toml"))
@link_option
@click.option("--check", is_flag=True, help="Only read the file and say what is in it; touch no hardware.")
@world_option
@place_option
@json_option
@library_option
@click.option("-q", "--quiet", is_flag=True, help="Say only what is wrong.")
def command(
    path: Path, *, link: str, check: bool, world: str | None, place: str | None, as_json: bool,
    folders: tuple[Path, ...], quiet: bool,
) -> None:  # fmt: skip
    """Run the parts that are wired to this computer, until Ctrl-C: those of FILE, parts.toml unless named.

    Each table [[part]] of it is one part, real or simulated. The file may be changed at any time: only what has
    changed in it is restarted.
    """
    from msbot.cli.run.hosting import connect, identify, run_until_told
    from msbot.hardware import PartsHost, read_parts

    if as_json and not check:
        raise ConfigError("--json tells what --check finds: write `msbot host --check --json`")
    WorldWishes(world, place).check()
    door = None if world is None else guest_door(world, place, click.echo)
    library = library_here(folders)
    parts = read_parts(path, library)
    if as_json:
        click.echo(json.dumps([_as_json(part) for part in parts]))
        return
    if check:
        for part in parts:
            words = "simulated" if part.wiring is None else part.wiring.words()
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
    wiring = None if part.wiring is None else part.wiring.words()
    return {"name": part.name, "part_number": part.number, "type": part.part_type.name, "wiring": wiring}

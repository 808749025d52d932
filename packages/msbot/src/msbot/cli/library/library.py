"""`msbot library`: the part types that robots are made of."""

from __future__ import annotations

import json
from pathlib import Path

import click

from msbot.cli.robot_options import answer_options, library_here, library_option, mistakes_told
from msbot_agent.cli.options import json_option


@click.group("library")
def command() -> None:
    """The part library: list it, search it, show a part type, check files, add a type of your own."""


@command.command("list")
@click.option("--category", metavar="WORD", help="Only these: sensor, input, actuator, display, power, board, other.")
@library_option
@json_option
def list_types(category: str | None, folders: tuple[Path, ...], *, as_json: bool) -> None:
    """List all part types: number, name, category and ports."""
    from msbot.cli.library.view import of_category, types_json, types_table

    types = of_category(library_here(folders), category)
    click.echo(types_json(types) if as_json else types_table(types))


@command.command("search")
@click.argument("words", nargs=-1, required=True)
@library_option
@json_option
def search(words: tuple[str, ...], folders: tuple[Path, ...], *, as_json: bool) -> None:
    """Find part types by WORDS: all of them must occur, beginnings will do, slips of the pen are forgiven."""
    from msbot.cli.library.view import types_json, types_table
    from msbot.config.library.search import PartSearch

    found = PartSearch(library_here(folders)).find(" ".join(words))
    if as_json:
        click.echo(types_json(found))
    elif found:
        click.echo(types_table(found))
    else:
        click.echo(f"Nothing in the library has all of: {' '.join(words)}. Try fewer words, or `msbot library list`.")


@command.command("show")
@click.argument("number")
@click.option("--picture", metavar="FILE", type=click.Path(path_type=Path), help="Write its picture to an SVG file.")
@library_option
@json_option
def show(number: str, picture: Path | None, folders: tuple[Path, ...], *, as_json: bool) -> None:
    """Show everything about the part type NUMBER: ports, settings, pins, supply, and what its simulator can do."""
    from msbot.cli.library.view import type_json, type_page, write_picture

    part_type = library_here(folders).require(number)
    if picture is not None:
        write_picture(part_type, picture)
    click.echo(type_json(part_type) if as_json else type_page(part_type))


@command.command("check")
@click.argument("paths", nargs=-1, type=click.Path(path_type=Path))
@json_option
def check(paths: tuple[Path, ...], *, as_json: bool) -> None:
    """Check the files or folders PATHS, together with what MsBOT brings.

    Every mistake is told with file, line and key (exit status 2). What is right but could be better is told as a hint.
    """
    from msbot.cli.library.view import hints

    with mistakes_told(as_json=as_json, hints=[]):
        library = library_here(paths)
    own = [part_type for part_type in library if not part_type.source.startswith("msbot library")]
    told = [f"{part_type.source}: {hint}" for part_type in own or library for hint in hints(part_type)]
    if as_json:
        click.echo(json.dumps({"problems": [], "hints": told}))
        return
    for line in told:
        source, _, hint = line.partition(": ")
        click.echo(f"{source}: hint: {hint}")
    added = f", {len(own)} of them from {', '.join(map(str, paths))}" if paths else ""
    click.echo(f"No mistake: {len(library)} part types{added}, {len(library.messages)} message types.")


@command.command("add")
@click.argument("what", metavar="FILE|NUMBER")
@click.option("--to", "folder", metavar="FOLDER", type=click.Path(path_type=Path), default=Path("library"),
              show_default=True, help="The robot's own library folder; made if it is not there.")  # fmt: skip
def add(what: str, folder: Path) -> None:
    """Add a part type to a robot's own library folder.

    FILE (it ends in .toml) is checked and copied. A new part NUMBER gets a commented file to fill in. Nothing is
    overwritten.
    """
    from msbot.cli.library.add import add_file, add_template

    path = add_file(Path(what), folder) if what.endswith(".toml") else add_template(what, folder)
    click.echo(f'{path} is written. Name its folder at the top of robot.toml:  library = ["{folder}"]')


@command.command("forget")
@click.argument("number")
@answer_options
def forget(number: str, db: str | None, robot: str | None) -> None:
    """Take the part type NUMBER, which a running robot has adopted, out of its library; then it can be adopted anew.

    Its slots must be gone: `msbot slot remove SLOT`.
    """
    from msbot.cli.change.robot_access import say

    say(db, robot, "forget_type", {"number": number})

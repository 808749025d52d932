"""`msbot library`: the part types that robots are made of."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import click

_Function = TypeVar("_Function", bound=Callable[..., object])


@click.group("library")
def command() -> None:
    """The part library: list it, search it, show a part type, check files, add a type of your own."""


def library_option(function: _Function) -> _Function:
    """`--library FOLDER`, as every command has it that reads the library."""
    return click.option(
        "--library", "folders", multiple=True, type=click.Path(path_type=Path),
        help="A folder with more part types (TOML files); may be given several times.",
    )(function)  # fmt: skip


json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of a table.")


@command.command("list")
@click.option("--category", metavar="WORD", help="Only these: sensor, input, actuator, display, power, board, other.")
@library_option
@json_option
def list_types(category: str | None, folders: tuple[Path, ...], *, as_json: bool) -> None:
    """List all part types: number, name, category and ports."""
    from msbot.cli.library_view import of_category, types_json, types_table
    from msbot.config import load_library

    types = of_category(load_library(*folders), category)
    click.echo(types_json(types) if as_json else types_table(types))


@command.command("search")
@click.argument("words", nargs=-1, required=True)
@library_option
@json_option
def search(words: tuple[str, ...], folders: tuple[Path, ...], *, as_json: bool) -> None:
    """Find part types by WORDS: all of them must occur, beginnings will do, slips of the pen are forgiven."""
    from msbot.cli.library_view import types_json, types_table
    from msbot.config import load_library
    from msbot.config.library_search import PartSearch

    found = PartSearch(load_library(*folders)).find(" ".join(words))
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
    from msbot.cli.library_view import type_json, type_page, write_picture
    from msbot.config import load_library

    part_type = load_library(*folders).require(number)
    if picture is not None:
        write_picture(part_type, picture)
    click.echo(type_json(part_type) if as_json else type_page(part_type))


@command.command("check")
@click.argument("paths", nargs=-1, type=click.Path(path_type=Path))
def check(paths: tuple[Path, ...]) -> None:
    """Check the files or folders PATHS, together with what MsBOT brings.

    Every mistake is told with file, line and key (exit status 2). What is right but could be better is told as a hint.
    """
    from msbot.cli.library_view import hints
    from msbot.config import load_library

    library = load_library(*paths)
    own = [part_type for part_type in library if not part_type.source.startswith("msbot library")]
    for part_type in own or library:
        for hint in hints(part_type):
            click.echo(f"{part_type.source}: hint: {hint}")
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
    from msbot.cli.library_add import add_file, add_template

    path = add_file(Path(what), folder) if what.endswith(".toml") else add_template(what, folder)
    click.echo(f"{path} is written. Start the robot with: msbot master robot.toml --library {folder}")

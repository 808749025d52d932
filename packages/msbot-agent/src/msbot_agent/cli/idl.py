"""`msbot idl`: message definitions of others as Python, C or IDL."""

from __future__ import annotations

from pathlib import Path

import click

from msbot_agent.cli.options import WholeRange
from msbot_agent.idl import read_definitions, to_c, to_idl, to_python

_FILE = click.argument("file", type=click.Path(exists=True, dir_okay=False, path_type=Path))
_PACKAGE = click.option(
    "--package",
    default="",
    metavar="NAME",
    help="The ROS package of a .msg or .srv file; default: from its package.xml or folder.",
)
_INCLUDE = click.option(
    "--include",
    multiple=True,
    metavar="FOLDER",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="A folder with ROS packages, or with the files that an .idl file includes; repeatable.",
)
_DEFINE = click.option(
    "--define",
    "-D",
    multiple=True,
    metavar="NAME",
    help="Define NAME for #ifdef in an .idl file; repeatable.",
)
_ROS = click.option("--ros", is_flag=True, help="Type names as ROS 2 has them in DDS, for an .idl file.")
_OUT = click.option(
    "--out", "-o", metavar="PATH", type=click.Path(path_type=Path), help="File to write; default: standard output."
)


@click.group("idl")
def command() -> None:
    """Turn message definitions (OMG IDL, ROS 2 .msg and .srv) into Python, C or IDL."""


@command.command("to-python")
@_FILE
@_ROS
@_PACKAGE
@_INCLUDE
@_DEFINE
@_OUT
def to_python_command(
    file: Path, *, ros: bool, package: str, include: tuple[Path, ...], define: tuple[str, ...], out: Path | None
) -> None:
    """Write message classes for MsBOT programs."""
    _put(
        to_python(read_definitions(file, package=package, include=include, is_ros=ros, defined=define), file.name), out
    )


@command.command("to-idl")
@_FILE
@_ROS
@_PACKAGE
@_INCLUDE
@_DEFINE
@_OUT
def to_idl_command(
    file: Path, *, ros: bool, package: str, include: tuple[Path, ...], define: tuple[str, ...], out: Path | None
) -> None:
    """Write OMG IDL for other DDS tools (fastddsgen, idlc)."""
    _put(to_idl(read_definitions(file, package=package, include=include, is_ros=ros, defined=define), file.name), out)


@command.command("to-c")
@_FILE
@_ROS
@_PACKAGE
@_INCLUDE
@_DEFINE
@click.option(
    "--out",
    "-o",
    metavar="STEM",
    type=click.Path(path_type=Path),
    help="Write STEM.h and STEM.c; default: in this folder, named as FILE.",
)
@click.option(
    "--text-bound",
    default=255,
    show_default=True,
    type=WholeRange(1, 65535),
    help="Bound of unbounded strings, in characters.",
)
@click.option(
    "--sequence-bound",
    default=64,
    show_default=True,
    type=WholeRange(1, 65535),
    help="Bound of unbounded sequences, in elements.",
)
def to_c_command(
    *,
    file: Path,
    ros: bool,
    package: str,
    include: tuple[Path, ...],
    define: tuple[str, ...],
    out: Path | None,
    text_bound: int,
    sequence_bound: int,
) -> None:
    """Write C for the Micro XRCE-DDS client: structs, and functions on Micro-CDR's API."""
    stem = out or Path(file.stem)
    definitions = read_definitions(file, package=package, include=include, is_ros=ros, defined=define)
    header, source = to_c(definitions, file.name, stem.name, text_bound=text_bound, sequence_bound=sequence_bound)
    _put(header, stem.with_name(f"{stem.name}.h"))
    _put(source, stem.with_name(f"{stem.name}.c"))


def _put(text: str, out: Path | None) -> None:
    if out is None:
        click.echo(text, nl=False)
        return
    try:
        out.write_text(text, "utf-8")
    except OSError as error:
        raise click.ClickException(f"{out}: {error.strerror}") from None
    click.echo(f"{out} is written.")

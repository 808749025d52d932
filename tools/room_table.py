"""Writes the lists of distributions and rooms in packages/README.md from the linter's contracts and the rooms.

    python tools/room_table.py           writes them
    python tools/room_table.py --check   says whether they are up to date (status 1 if not); a test does the same

The layers come from `pyproject.toml`, what a room is from the first line of its docstring, its third-party libraries
from its import statements.
"""

from __future__ import annotations

import ast
import sys
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from tools.sources import PACKAGES, ROOT

PAGE = ROOT / "packages/README.md"
BEGIN = "<!-- made by tools/room_table.py from pyproject.toml -->\n"
END = "<!-- end of what is made -->\n"
OWN = {path.stem for package in PACKAGES for path in (package, *package.parent.glob("*.py"))}


def table() -> str:
    """The distributions and their rooms from top to bottom, in Markdown."""
    layers_of = dict(_layers())
    lines = []
    for package in reversed(PACKAGES):
        project = tomllib.loads((package.parents[1] / "pyproject.toml").read_text("utf-8"))["project"]
        layers = layers_of.get(package, [])
        uses = "" if layers else _used(sorted(package.rglob("*.py")))
        lines += [f"## {project['name']}", "", f"{project['description']}{uses}.", ""]
        for number, layer in enumerate(layers, start=1):
            for room in layer:
                uses = _used(_files(package / room))
                lines.append(f"* {number} `{package.name}.{room}`: {_is(package / room)}{uses}")
        if lines[-1]:
            lines.append("")
    return "\n".join(lines[:-1]) + "\n"


def third_party(files: Iterable[Path]) -> set[str]:
    """Top-level names of the libraries that files import."""
    found = set()
    for path in files:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                found.add(node.module or "")
    return {name.partition(".")[0] for name in found} - set(sys.stdlib_module_names) - OWN


def page() -> str:
    """The page as it should be."""
    before, _, rest = PAGE.read_text("utf-8").partition(BEGIN)
    return f"{before}{BEGIN}{table()}{END}{rest.partition(END)[2]}"


def _layers() -> Iterator[tuple[Path, list[list[str]]]]:
    """Each package that is divided into rooms, with its rooms from the top down."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    for package in reversed(PACKAGES):
        for contract in contracts:
            if contract.get("containers") == [package.name]:
                yield package, [[room.strip() for room in layer.split("|")] for layer in contract["layers"]]


def _used(files: Iterable[Path]) -> str:
    """The third-party libraries of these files, in brackets."""
    names = sorted(third_party(files))
    return f" ({', '.join(names)})" if names else ""


def _files(room: Path) -> list[Path]:
    return sorted(room.rglob("*.py")) if room.is_dir() else [room.with_suffix(".py")]


def _is(room: Path) -> str:
    path = room / "__init__.py" if room.is_dir() else room.with_suffix(".py")
    words = ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
    return " ".join(words.partition("\n\n")[0].split()).rstrip(".:")


if __name__ == "__main__":
    wanted = page()
    if wanted != PAGE.read_text("utf-8"):
        if "--check" in sys.argv[1:]:
            sys.exit("packages/README.md is not up to date: run `python tools/room_table.py`")
        PAGE.write_text(wanted, "utf-8")

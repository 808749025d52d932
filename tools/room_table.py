"""Writes the table of rooms in CONTRIBUTING.md from what holds: the linter's contract, and the rooms themselves.

    python tools/room_table.py           writes it
    python tools/room_table.py --check   says whether it is up to date (status 1 if not); a test does the same

Order and rights come from the layers in `pyproject.toml`, what a room is from the first line of its docstring, its
third-party libraries from the import statements in it.
"""

from __future__ import annotations

import ast
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "CONTRIBUTING.md"
BEGIN = "<!-- made by tools/room_table.py from pyproject.toml -->\n"
END = "<!-- end of what is made -->\n"


def table() -> str:
    """The rooms from top to bottom, in Markdown."""
    layers = [[room.strip() for room in layer.split("|")] for layer in _layers()]
    rows = ["| room | is | may import | third party |", "|---|---|---|---|"]
    for depth, layer in enumerate(layers):
        below = f"`{'`, `'.join(layers[depth + 1])}` and below" if depth + 2 < len(layers) else ""
        if depth + 2 == len(layers):
            below = f"`{'`, `'.join(layers[depth + 1])}`"
        for room in layer:
            others = ", ".join(sorted(third_party(room))) or "–"
            rows.append(f"| `{room}` | {_is(room)} | {below or '–'} | {others} |")
    return "\n".join(rows) + "\n"


def third_party(room: str) -> set[str]:
    """Top-level names of the libraries that a room imports."""
    found = set()
    for path in _files(room):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                found.add(node.module or "")
    return {name.partition(".")[0] for name in found} - set(sys.stdlib_module_names) - {"msbot"}


def page() -> str:
    """CONTRIBUTING.md as it should be."""
    before, _, rest = PAGE.read_text("utf-8").partition(BEGIN)
    return f"{before}{BEGIN}{table()}{END}{rest.partition(END)[2]}"


def _layers() -> list[str]:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]["contracts"]
    layers = next(contract for contract in contracts if contract["type"] == "layers")["layers"]
    return list(layers)


def _files(room: str) -> list[Path]:
    folder = ROOT / "src/msbot" / room
    return sorted(folder.rglob("*.py")) if folder.is_dir() else [folder.with_suffix(".py")]


def _is(room: str) -> str:
    folder = ROOT / "src/msbot" / room
    path = folder / "__init__.py" if folder.is_dir() else folder.with_suffix(".py")
    words = ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
    return " ".join(words.partition("\n\n")[0].split()).rstrip(".:")


if __name__ == "__main__":
    wanted = page()
    if wanted != PAGE.read_text("utf-8"):
        if "--check" in sys.argv[1:]:
            sys.exit("CONTRIBUTING.md: the table of rooms is not up to date: run `python tools/room_table.py`")
        PAGE.write_text(wanted, "utf-8")

"""Writes requirements/{run,computer,dev,docs}.txt: what is installed, with versions and hashes of files.

    python tools/requirements.py .venv/bin/uv [--upgrade]        (or: make requirements [ARGS=--upgrade])

For every system and every Python that MsBOT runs with. Versions stay where they still fit; `--upgrade` chooses the
newest. The build backend is among them, so that nothing is downloaded unchecked. All extras and groups are resolved
first, and each file follows that choice: two of them name the same package only in the same version. The five
distributions themselves are installed from where they lie, so no file names them.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

FOLDER = Path("requirements")
FILES = {"run": ("demo", ""), "computer": ("computer", ""), "dev": ("all", "dev"), "docs": ("master", "docs")}
"""By file: the extra of the distributions, and the group of the workspace; empty: none."""
BUILD = "hatchling\neditables\n"  # what builds MsBOT, and lets it be used where it lies
PIP = "pip\n"  # with which people add to the environment of `make`; that of the Debian package is not theirs to change
HEAD = "# What `make` installs. Made by `make requirements` from packages/*/pyproject.toml; not to be edited.\n"
OPTIONS = ["--universal", "--python-version", "3.11", "--no-emit-index-url", "--no-header", "--no-annotate", "--quiet"]


def main(uv: str, *options: str) -> int:
    """Write the files."""
    with tempfile.TemporaryDirectory() as scratch:
        build = Path(scratch, "build.in")
        build.write_text(BUILD + PIP, encoding="utf-8")
        chosen = Path(scratch, "all.txt")
        chosen.write_text("\n".join(versions_now()), encoding="utf-8")  # uv keeps what the file that it writes names
        resolve(uv, build, chosen, "--all-extras", *groups("dev", "docs"), *options)
        for name, (extra, group) in FILES.items():
            made = Path(scratch, f"{name}.txt")
            build.write_text(BUILD + PIP * (name != "computer"), encoding="utf-8")
            wanted = ["--extra", extra, *groups(*filter(None, [group]))]
            resolve(uv, build, made, *wanted, "--constraint", str(chosen), "--generate-hashes")
            (FOLDER / made.name).write_text(HEAD + made.read_text(encoding="utf-8"), encoding="utf-8")
    return 0


def versions_now() -> list[str]:
    """What the files name now, without hashes."""
    lines = {line for path in FOLDER.glob("*.txt") for line in path.read_text(encoding="utf-8").splitlines()}
    return sorted(line.removesuffix(" \\") for line in lines if line[:1].isalnum())


def groups(*names: str) -> list[str]:
    """The options of uv for groups of the workspace."""
    return [word for name in names for word in ("--group", f"pyproject.toml:{name}")]


def resolve(uv: str, build: Path, into: Path, *options: str) -> None:
    """Let uv choose versions for the distributions and the build backend."""
    projects = [str(path) for path in sorted(Path("packages").glob("*/pyproject.toml"))]
    own = [word for path in projects for word in ("--no-emit-package", Path(path).parent.name)]
    command = [uv, "pip", "compile", *projects, str(build), *OPTIONS, *own, *options, "--output-file", str(into)]
    subprocess.run(command, check=True)


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))

"""Writes requirements/{run,dev,docs}.txt: what `make` installs, each with its version and the hashes of its files.

    python tools/requirements.py .venv/bin/uv [--upgrade]        (or: make requirements [ARGS=--upgrade])

For every system and every Python that MsBOT runs with. Versions stay where they still fit; `--upgrade` chooses the
newest. The build backend is among them, so that nothing is downloaded unchecked. All extras are resolved first, and
each file follows that choice: two of them name the same package only in the same version.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

FOLDER = Path("requirements")
EXTRAS = {"run": ("master",), "dev": ("all", "dev"), "docs": ("master", "docs")}
BUILD = "hatchling\neditables\n"  # what builds MsBOT, and lets it be used where it lies
HEAD = "# What `make` installs. Made by `make requirements` from pyproject.toml; not to be edited.\n"
OPTIONS = ["--universal", "--python-version", "3.11", "--no-emit-index-url", "--no-header", "--no-annotate", "--quiet"]


def main(uv: str, *options: str) -> int:
    """Write the three files."""
    with tempfile.TemporaryDirectory() as scratch:
        build = Path(scratch, "build.in")
        build.write_text(BUILD, encoding="utf-8")
        chosen = Path(scratch, "all.txt")
        chosen.write_text("\n".join(versions_now()), encoding="utf-8")  # uv keeps what the file that it writes names
        resolve(uv, build, chosen, "--all-extras", *options)
        for name, extras in EXTRAS.items():
            made = Path(scratch, f"{name}.txt")
            wanted = [word for extra in extras for word in ("--extra", extra)]
            resolve(uv, build, made, *wanted, "--constraint", str(chosen), "--generate-hashes")
            (FOLDER / made.name).write_text(HEAD + made.read_text(encoding="utf-8"), encoding="utf-8")
    return 0


def versions_now() -> list[str]:
    """What the three files name now, without hashes."""
    lines = {line for path in FOLDER.glob("*.txt") for line in path.read_text(encoding="utf-8").splitlines()}
    return sorted(line.removesuffix(" \\") for line in lines if line[:1].isalnum())


def resolve(uv: str, build: Path, into: Path, *options: str) -> None:
    """Let uv choose versions for pyproject.toml and the build backend."""
    command = [uv, "pip", "compile", "pyproject.toml", str(build), *OPTIONS, *options, "--output-file", str(into)]
    subprocess.run(command, check=True)


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))

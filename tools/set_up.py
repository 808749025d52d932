"""Installs MsBOT and what it needs into an environment, and shows how far it is; called by the Makefile.

    python tools/set_up.py .venv/bin/python '.[master]' [more ...]

pip works from outside the environment (pip >= 22.3), so that a Python without ensurepip will do. What is shown goes to
standard error; when something fails, the last lines of pip tell what.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections import deque
from pathlib import Path

PACKAGE = re.compile(r"^\s*(?:Collecting|Requirement already satisfied:) ([\w.-]+)")
PHASES = {"Installing collected packages": "installing them, which takes half of the time",
          "Successfully installed": "they are installed"}  # fmt: skip
COMPILING = "compiling MsBOT, so that its first start is as quick as the next one"


def main(python: str, *wanted: str) -> int:
    """Install; returns the exit status of pip."""
    command = [
        sys.executable, "-m", "pip", "--python", python, "install", "--progress-bar", "off",
               "--disable-pip-version-check", "--no-input", "--constraint", "constraints.txt", "--editable", *wanted,
    ]  # fmt: skip
    lines: deque[str] = deque(maxlen=20)
    seen: set[str] = set()
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as pip:
        assert pip.stdout is not None
        for line in pip.stdout:
            lines.append(line)
            if found := PACKAGE.match(line):
                seen.add(found[1].lower())
                say(f"{len(seen)} packages looked up, now {found[1]}")
            for begin, words in PHASES.items():
                if line.startswith(begin):
                    say(words)
    if not pip.returncode:
        point_without_letters(Path(python).parents[1])
        say(COMPILING)
        # pip does this for what it installs, but not for what is used where it lies; the first start would take twice
        # as long. A folder that cannot be written to is no reason to fail.
        subprocess.run([python, "-m", "compileall", "-q", "-j", "0", "src"], stdout=subprocess.DEVNULL, check=False)
    if sys.stderr.isatty():
        sys.stderr.write("\r\033[K")
    if pip.returncode:
        sys.stderr.write("".join(lines) + "\nThe set-up failed; the lines above are pip's.\n")
    return pip.returncode


def point_without_letters(environment: Path) -> None:
    """Let the environment find MsBOT by a path relative to itself.

    pip writes the whole path. Python before 3.13 reads it in the letters of the locale, so that with LC_ALL=C no
    program of an environment in a folder like `Tür 1` would start.
    """
    for pointer in environment.glob("lib/python*/site-packages/_editable_impl_msbot.pth"):
        # Python completes the path without looking at links, and so does this.
        lines = pointer.read_text(encoding="utf-8").splitlines()
        relative = [os.path.relpath(line, os.path.abspath(pointer.parent)) for line in lines if line]
        pointer.write_text("\n".join(relative) + "\n", encoding="utf-8")


_last = ""


def say(words: str) -> None:
    """Show one state: over the last one on a terminal, else only what is new and no mere count."""
    global _last  # noqa: PLW0603 - one line of output
    if sys.stderr.isatty():
        sys.stderr.write(f"\r\033[K  {words}"[:100])
    elif words in (*PHASES.values(), COMPILING) and words != _last:
        sys.stderr.write(f"  {words}\n")
    _last = words
    sys.stderr.flush()


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))

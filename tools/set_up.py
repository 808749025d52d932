"""Installs MsBOT and what it needs into an environment, and shows how far it is; called by the Makefile.

    python tools/set_up.py [--no-hashes] .venv/bin/python requirements/run.txt

First what the file names, each package in its version and with one of its hashes; then MsBOT itself, built by what has
just been installed. `--no-hashes` takes the versions only: piwheels, which Raspberry Pi OS asks, makes wheels of its
own of the same versions.

pip works from outside the environment (pip >= 22.3), so that a Python without ensurepip will do. What is shown goes to
standard error; when something fails, the last lines of pip tell what.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections import deque
from pathlib import Path

PACKAGE = re.compile(r"^\s*(?:Collecting|Requirement already satisfied:) ([\w.-]+)")
HASH = re.compile(r" \\\n\s*--hash=\S+")
PHASES = {
    "Installing collected packages": "installing them, which takes half of the time",
    "Successfully installed": "they are installed",
}
DISTRIBUTIONS = ("msbot-xrce", "msbot-agent", "msbot", "msbot-school", "msbot-bridges", "msbot-web")
SCRIPT = """\
import sys

silent = KeyboardInterrupt
sys.excepthook = lambda kind, *rest: issubclass(kind, silent) or sys.__excepthook__(kind, *rest)

from msbot_command import main

if __name__ == "__main__":
    sys.exit(main())
"""
"""Of the command `msbot`, behind the lines that say which Python runs it."""
BLOCKED = ("/usr/bin/env", "--block-signal=INT")
"""Starts a program in which SIGINT waits until the program lets it through (GNU coreutils 8.31)."""
COMPILING = "compiling MsBOT, so that its first start is as quick as the next one"
WRONG_HASH = "DO NOT MATCH THE HASHES"
"""How pip begins when a file is not the one that it should be."""


def main(*arguments: str) -> int:
    """Install; returns the exit status of pip."""
    python, requirements = (argument for argument in arguments if argument != "--no-hashes")
    status = install_requirements(python, Path(requirements), hashes="--no-hashes" not in arguments)
    if not status:
        own = [word for name in DISTRIBUTIONS for word in ("--editable", f"packages/{name}")]
        status = run_pip(python, "--no-deps", "--no-build-isolation", *own)
    if not status:
        point_without_letters(Path(python).parents[1])
        begin_quickly(Path(python).with_name("msbot"))
        say(COMPILING)
        # pip does this for what it installs, but not for what is used where it lies; the first start would take twice
        # as long. A folder that cannot be written to is no reason to fail.
        subprocess.run(
            [python, "-m", "compileall", "-q", "-j", "0", *(f"packages/{name}/src" for name in DISTRIBUTIONS)],
            stdout=subprocess.DEVNULL,
            check=False,
        )
    end_line()
    return status


def install_requirements(python: str, requirements: Path, *, hashes: bool) -> int:
    """Install what a file of requirements/ names; the file names everything, so pip adds nothing to it."""
    if hashes:
        return run_pip(python, "--no-deps", "--require-hashes", "--requirement", str(requirements))
    with tempfile.TemporaryDirectory() as scratch:
        versions = Path(scratch, requirements.name)
        versions.write_text(HASH.sub("", requirements.read_text(encoding="utf-8")), encoding="utf-8")
        return run_pip(python, "--no-deps", "--requirement", str(versions))


def run_pip(python: str, *what: str) -> int:
    """Let pip install something, and show what it says: a state at a time, and its last lines when it fails."""
    command = [sys.executable, "-m", "pip", "--python", python, "install", "--progress-bar", "off"]
    command += ["--disable-pip-version-check", "--no-input", *what]
    lines: deque[str] = deque(maxlen=20)
    seen: set[str] = set()
    wrong_hash = False
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as pip:
        assert pip.stdout is not None
        for line in pip.stdout:
            lines.append(line)
            wrong_hash |= WRONG_HASH in line
            if found := PACKAGE.match(line):
                seen.add(found[1].lower())
                say(f"{len(seen)} packages looked up, now {found[1]}")
            for begin, words in PHASES.items():
                if line.startswith(begin):
                    say(words)
    if pip.returncode:
        end_line()
        sys.stderr.write("".join(lines) + "\nThe set-up failed; the lines above are pip's.\n")
    if wrong_hash:
        sys.stderr.write(
            "A package is not the file that the project was tested with, so nothing was installed. Where pip asks a"
            " server that makes files of its own (a Raspberry Pi asks piwheels; `pip config list` tells), take the"
            " versions without the hashes: make demo HASHES=no. Anywhere else somebody may have changed the file.\n"
        )
    return pip.returncode


def point_without_letters(environment: Path) -> None:
    """Let the environment find MsBOT by a path relative to itself.

    pip writes the whole path. Python before 3.13 reads it in the letters of the locale, so that with LC_ALL=C no
    program of an environment in a folder like `Tür 1` would start.
    """
    # hatch names the pointer by how a distribution is laid out: `_editable_impl_msbot.pth`, `_msbot_agent.pth`.
    for pointer in environment.glob("lib/python*/site-packages/_*msbot*.pth"):
        # Python completes the path without looking at links, and so does this.
        lines = pointer.read_text(encoding="utf-8").splitlines()
        relative = [os.path.relpath(line, os.path.abspath(pointer.parent)) for line in lines if line]
        pointer.write_text("\n".join(relative) + "\n", encoding="utf-8")


def begin_quickly(script: Path) -> None:
    """Let the command begin with what keeps Ctrl-C from showing a traceback.

    The script of pip before 25 first imports `re` with a dozen modules, in which the hooks of `msbot_command` are not
    there yet. While Python itself begins, no hook is: it starts with SIGINT blocked where this computer can do that.
    """
    if not script.is_file():  # Windows has programs in their place
        return
    text = script.read_text(encoding="utf-8")
    if imports := re.search(r"^import (?:re|sys)$", text, re.MULTILINE):
        head = text[: imports.start()]
        script.write_text((_blocking(head) if can_block() else head) + SCRIPT, encoding="utf-8")


def can_block() -> bool:
    """Whether this computer can start a program with SIGINT blocked: BusyBox and macOS cannot."""
    try:
        return not subprocess.run([*BLOCKED, "true"], capture_output=True, check=False).returncode
    except OSError:
        return False


def _blocking(head: str) -> str:
    """The lines that say which Python runs a script, so that it starts with SIGINT blocked.

    There are two kinds: `#!PYTHON`, and three lines that are a program of the shell and a text of Python.
    """
    begin = f"'''exec' {' '.join(BLOCKED)} "
    if BLOCKED[1] in head:
        return head
    if head.startswith("#!/bin/sh\n'''exec' "):
        return head.replace("'''exec' ", begin, 1)
    first, _, rest = head.partition("\n")
    python = first.removeprefix("#!").strip()
    if not first.startswith("#!/") or " " in python or "\\" in python:  # Python would read a backslash as its own
        return head
    return f"#!/bin/sh\n{begin}{shlex.quote(python)} \"$0\" \"$@\"\n' '''\n{rest}"


def end_line() -> None:
    """Clear the line of states, so that what follows begins on one of its own."""
    if sys.stderr.isatty():
        sys.stderr.write("\r\033[K")


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

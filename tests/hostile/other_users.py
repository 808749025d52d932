"""Programs of other users of the computer: real ones, as the system sees them."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

NOBODY, VICTIM = 65534, 1
"""The attacker, and whose robot it is (`daemon` on Debian)."""
PYTHON = shutil.which("python3", path="/usr/bin:/bin")
"""One that every user may run."""
needs_users = pytest.mark.skipif(
    sys.platform != "linux" or os.geteuid() != 0 or PYTHON is None or shutil.which("setpriv") is None,
    reason="needs Linux, root, setpriv and a python3 that every user may run, to be another user",
)


def as_user(user: int, *, may_read: bool = False) -> list[str]:
    """The command in front of a command that makes it another user's.

    Args:
        user: whose.
        may_read: it may read every file, as this environment may be in a folder of root's.
    """
    words = ["setpriv", f"--reuid={user}", f"--regid={user}", "--clear-groups"]
    if not may_read:
        return [*words, "--bounding-set=-all"]
    return [*words, "--inh-caps=+dac_read_search", "--ambient-caps=+dac_read_search"]


@contextmanager
def attacker(script: str, *arguments: str, user: int = NOBODY) -> Iterator[subprocess.Popen[str]]:
    """A program of another user that runs until the end of the block, once it has printed `ready`."""
    assert PYTHON is not None
    process = subprocess.Popen(
        [*as_user(user), PYTHON, "-I", "-c", script, *arguments],
        stdout=subprocess.PIPE,
        text=True,
        cwd="/",
        process_group=0,
    )
    try:
        assert process.stdout is not None
        said = process.stdout.readline()
        assert said == "ready\n", said
        yield process
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


@contextmanager
def master_of(user: int, folder: Path, env: dict[str, str], *, around: tuple[str, ...] = ()) -> Iterator[Path]:
    """A master of that user, as it is started by hand, in a folder of theirs; yields the file with what it prints.

    Args:
        user: whose.
        folder: is theirs from now on.
        env: what is different from the environment of the tests.
        around: the command that starts it, for example in a file system of its own.
    """
    (folder / "own").mkdir(mode=0o755)
    for path in (folder, folder / "own"):
        os.chown(path, user, user)
    log = folder / "log"
    command = [*around, *as_user(user, may_read=True), sys.executable, "-m", "msbot", "master"]
    with log.open("w") as out:
        process = subprocess.Popen(
            [
                *command,
                str(folder / "robot.toml"),
                "--db",
                str(folder / "own/robot.db"),
                "--no-page",
                "--link",
                "udp:127.0.0.1:0",
                "--rec",
                "off",
            ],
            cwd=folder,
            env={
                **os.environ,
                "PYTHONUNBUFFERED": "1",
                "LOGNAME": "daemon",
                "XDG_STATE_HOME": str(folder / "own"),
                "XDG_RUNTIME_DIR": str(folder / "own"),
                **env,
            },
            stdout=out,
            stderr=out,
            process_group=0,
        )
    try:
        yield log
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()

"""What a demo hands to the one that takes its place, when a person on the page chooses another robot.

The process starts itself anew with the same command line, in the same terminal, under the same number. A file in the
demo's own folder, which only this user can read, says what goes before the command line: the robot, its world, a
lesson, the port, who is signed in, and whether STOP holds. The folder, with the database, goes from one to the next;
the last one removes it.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any, NoReturn

import click

from msbot_web.access.sessions import KeptSession
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

FILE = "handover.json"


@dataclass(frozen=True, slots=True)
class Handover:
    """See the module's docstring."""

    robot: str
    world: str
    lesson: str
    who: str
    """Who has chosen it."""
    port: int
    left_s: float | None
    """Seconds until the demo ends by itself; None: it does not."""
    entry_token: str
    sessions: list[KeptSession]
    stop_by: str = ""
    """Who has said STOP, if it holds."""
    stop_reason: str = ""
    stopped: bool = False

    def write(self, folder: Path) -> None:
        """Keep it for the next process."""
        descriptor = os.open(folder / FILE, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(descriptor, "w", encoding="utf-8") as file:
            json.dump(asdict(self), file)


def read_handover(folder: Path) -> Handover:
    """What the process before has left; it is read once.

    Raises:
        ConfigError: there is none: the option is for the demo itself.
    """
    path = folder / FILE
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        path.unlink()
        return Handover(**{**content, "sessions": [KeptSession(**one) for one in content["sessions"]]})
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path}: no demo has left anything here to go on with ({error})") from None


class DemoCommand(click.Command):
    """Remembers its command line, for the process that takes this one's place."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """As click does it."""
        ctx.meta[__name__] = list(args)
        return super().parse_args(ctx, args)


def own_arguments() -> list[str]:
    """The command line of the demo that runs, without what an earlier one has added."""
    words: list[str] = click.get_current_context().meta[__name__]
    return words[: words.index("--go-on")] if "--go-on" in words else words


@contextmanager
def demo_folder(left_by: Path | None) -> Iterator[Path]:
    """The demo's own folder, a new one or that of the demo before; it is removed at the end."""
    if left_by is None:
        with tempfile.TemporaryDirectory(prefix="msbot-demo-") as folder:
            yield Path(folder)
        return
    try:
        yield left_by
    finally:
        shutil.rmtree(left_by, ignore_errors=True)


def start_anew(arguments: Sequence[str], folder: Path) -> NoReturn:
    """Become the demo that goes on; to be called when everything of this one is closed."""
    command = [sys.executable, "-m", "msbot_agent", "demo", *arguments, "--go-on", str(folder)]
    sys.stdout.flush()
    sys.stderr.flush()
    if sys.platform != "win32":
        os.execv(sys.executable, command)  # noqa: S606 - this program itself
    process = subprocess.Popen(command)  # exec would give the terminal back there, as if the demo were over
    while True:
        try:
            sys.exit(process.wait())
        except KeyboardInterrupt:
            continue  # the other one ends by it, too

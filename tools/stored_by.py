"""Keeps what this version of MsBOT stores, so that later versions can be tried on it.

    .venv/bin/python tools/stored_by.py         into packages/msbot/tests/upgrades/stored/VERSION

A robot of the demo runs for some seconds, a person changes it through the API, and its master ends. What it has written
is kept: database, blueprint, recording, UID and key of a part, the files of a board, and what the API has answered;
besides, what people write for this version: part types, worlds, lessons, missions. A folder that is there already is
left alone: it is what that version has stored.
"""

from __future__ import annotations

import gzip
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))

from msbot.config import board_documents, load_library
from msbot.config.library.board_wiring import wired_parts
from tools.release.building import pack
from tools.sources import ROOT
from tools.version import read

STORED = ROOT / "packages/msbot/tests/upgrades/stored"
PATHS = (
    "arrivals", "blueprint", "bus", "edits", "gallery", "health", "journal", "library", "log", "me", "parts",
    "programs", "robot", "robots", "slots/fan", "slots/fan/values", "status", "tickets", "timeline", "topics", "users",
    "why/fan",
)  # fmt: skip
"""What is asked of the API."""
WIRED = {"part_1": "LED lamp: s=2", "part_2": "RELAY-1 relay: s=12, active_low=true"}
"""What is wired to the board, which keeps it in `parts.json`."""
KEEP = """
import json, sys, types
sys.modules["micropython"] = types.SimpleNamespace(const=int)
sys.path.insert(0, sys.argv[1])
from msbot.generic import keep
keep(json.load(sys.stdin))
"""
PATIENCE_S = 120.0
Ask = Callable[[str], Any]


def main() -> int:
    """Run the robot and keep what it stores."""
    into = STORED / read()
    if into.exists():
        sys.stderr.write(f"{into.relative_to(ROOT)} is there already: what a version has stored is not changed\n")
        return 1
    with tempfile.TemporaryDirectory() as scratch:
        here = Path(scratch)
        kept = here / "kept"
        kept.mkdir()
        with RunningDemo(here, "--rec", str(here / "recording.mcap")) as ask:
            _msbot(here, "set", "beacon", "brightness", "0.5", "--db", "robot.db")
            answers = {path: ask(path) for path in PATHS}
            answers["me"]["csrf"] = "x"  # it is a secret of that session
        state = here / "home/.local/state/msbot"
        _msbot(here, "key", "new", "SG90", "--name", "arm", "--here", "--no-qr", "--db", "robot.db")
        _msbot(here, "user", "add", "ann", "--password-stdin", "--db", "robot.db", typed="a long password\n")
        _msbot(here, "db", "backup", "copy.db", "--db", "robot.db")
        (here / "robot.toml").write_text(_msbot(here, "export", "--db", "robot.db"), "utf-8")
        _pack(here / "copy.db", kept / "robot.db.gz")
        _pack(here / "recording.mcap", kept / "recording.mcap.gz")
        (kept / "api.json").write_text(
            json.dumps(answers, indent=1, sort_keys=True, ensure_ascii=False) + "\n", "utf-8"
        )
        shutil.copy(here / "robot.toml", kept)
        for what in ("uid", "key"):
            shutil.copytree(state / what, kept / "state" / what)
        (uid,), (key,) = ((state / what).iterdir() for what in ("uid", "key"))
        board = {"link": "can:1?bitrate=500000", "uid": uid.read_text().strip(), "key": key.read_text().strip()}
        (kept / "board").mkdir()
        (kept / "board/msbot.json").write_text(json.dumps(board) + "\n")
        _keep_wiring(kept / "board")
        keep_files(kept)
        shutil.copytree(kept, into)
    sys.stdout.write(f"{into.relative_to(ROOT)}\n")
    return 0


def _keep_wiring(folder: Path) -> None:
    """Write what a board keeps of its parts, with the board's own code."""
    documents = board_documents(wired_parts(WIRED, load_library()))
    command = [sys.executable, "-c", KEEP, str(ROOT / "micropython")]
    subprocess.run(command, cwd=folder, input=json.dumps([*documents.values()]), text=True, check=True)


def keep_files(into: Path) -> None:
    """Keep files such as people write for this version: those that it brings itself have all keys of each kind."""
    extension = ROOT / "examples/extension/src/msbot_hello"
    kinds = {
        "library": [
            *(ROOT / "packages/msbot/src/msbot/config/library/types").glob("*.toml"),
            *(extension / "part_types").glob("*.toml"),
            *(extension / "messages").glob("*.toml"),
        ],
        "worlds": [*(ROOT / "packages/msbot/src/msbot/sim/arena/worlds").glob("*.toml")],
        "lessons": [*(ROOT / "lessons").glob("*.md")],
        "missions": [*(ROOT / "packages/msbot-school/src/msbot_school/missions/ready").glob("*.toml")],
    }
    with tempfile.TemporaryDirectory() as scratch:
        for kind, paths in kinds.items():
            folder = Path(scratch, kind)
            folder.mkdir()
            for path in paths:
                text = path.read_text("utf-8")
                # A part number of its own, beside that of the same type in a later version.
                text = re.sub(r'^number = "(.*)"', r'number = "\1-KEPT"', text, count=1, flags=re.MULTILINE)
                (folder / path.name).write_text(text, "utf-8")
        pack(Path(scratch), "files", into, 0)


class RunningDemo:
    """A robot of the demo with its database in `robot.db` of a folder; gives what asks its API as the administrator."""

    def __init__(self, folder: Path, *options: str) -> None:
        self._folder, self._options = folder, options

    def __enter__(self) -> Ask:
        """Start it, and wait until all its parts work."""
        log = self._folder / "demo.log"
        command = [sys.executable, "-m", "msbot", "demo", "--port", "0", "--db", "robot.db", *self._options]
        with log.open("wb") as output:
            self._process = subprocess.Popen(
                command, cwd=self._folder, env=environment(self._folder), stdout=output, stderr=subprocess.STDOUT
            )
        try:
            return self._wait(log)
        except BaseException:
            self.__exit__()
            raise

    def __exit__(self, *_: object) -> None:
        """End it as a person does."""
        self._process.terminate()
        self._process.wait(PATIENCE_S)

    def _wait(self, log: Path) -> Ask:
        end = time.monotonic() + PATIENCE_S
        ask: Ask | None = None
        while time.monotonic() < end and self._process.poll() is None:
            link = next((word for word in log.read_text("utf-8").split() if word.startswith("http://")), None)
            if ask is None and link is not None:
                ask = asking(link)
            if ask is not None and (status := ask("status"))["active"] == status["slots"]:
                return ask
            time.sleep(0.3)
        raise RuntimeError(f"the robot does not come up:\n{log.read_text('utf-8')}")


def asking(link: str) -> Ask:
    """What asks the API as the person whom the link lets in."""
    opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
    opener.open(link, timeout=PATIENCE_S).close()
    address = "/".join(link.split("/")[:3])

    def ask(path: str) -> Any:  # noqa: ANN401 - JSON
        with opener.open(f"{address}/api/{path}", timeout=PATIENCE_S) as answer:
            text = answer.read().decode()
            return json.loads(text) if "json" in answer.headers["Content-Type"] else text

    return ask


def environment(folder: Path) -> dict[str, str]:
    """A home of its own, and a STOP group of its own."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("MSBOT_", "XDG_"))}
    return {**kept, "HOME": str(folder / "home"), "MSBOT_STOP_GROUP": "stored-by", "PYTHONUNBUFFERED": "1"}


def _msbot(folder: Path, *arguments: str, typed: str = "") -> str:
    command = [sys.executable, "-m", "msbot", *arguments]
    done = subprocess.run(
        command, cwd=folder, env=environment(folder), input=typed, stdout=subprocess.PIPE, text=True, check=True
    )
    return done.stdout


def _pack(source: Path, target: Path) -> None:
    target.write_bytes(gzip.compress(source.read_bytes(), mtime=0))


if __name__ == "__main__":
    raise SystemExit(main())

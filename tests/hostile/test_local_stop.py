"""Other users of the computer attack `msbot stop`: planted folders, sockets with its names, floods. STOP gets through.

They are real ones: their programs run as `nobody`, the robot's master as `daemon`, and root says STOP to everybody's.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from msbot.config import SAMPLE_ROBOT_TOML
from msbot.stop.socket_folders import PREFIX, SHARED_FOLDER
from tests.hostile.other_users import NOBODY, VICTIM, as_user, attacker, master_of, needs_users

pytestmark = needs_users
PATIENCE_S = 90.0
PLANTS = """
import os, sys, time
start = sys.argv[1]
os.mkdir(start, 0o777)
os.chmod(start, 0o777)
for number in range(50):
    os.mkdir(f"{start}-{number}", 0o700)
os.symlink("/run", f"{start}-link")
with open(f"{start}-file", "w") as file:
    file.write("x")
os.mkfifo(f"{start}-pipe")
print("ready", flush=True)
time.sleep(600)
"""
"""Has the names of folders that the victim's master would take."""
LISTENS = """
import resource, socket, sys, time
start, group = sys.argv[1].encode(), sys.argv[2].encode()
resource.setrlimit(resource.RLIMIT_NOFILE, (min(3000, resource.getrlimit(resource.RLIMIT_NOFILE)[1]),) * 2)
held = []
def take(kind, name, full):
    one = socket.socket(socket.AF_UNIX, kind)
    one.bind(b"\\0" + name)
    held.append(one)
    if kind == socket.SOCK_STREAM:
        one.listen(0)
        if full:
            other = socket.socket(socket.AF_UNIX, kind)
            other.setblocking(False)
            try:
                other.connect(b"\\0" + name)
            except BlockingIOError:
                pass
            held.append(other)
for number in range(900):
    take(socket.SOCK_STREAM, start + b"%d-abcdef.%s.00000000.ROVER~20X%d" % (number + 1, group, number), number % 2)
odd = b"\\xff\\xfe", b"1-a." + group + b".00000000.\\xff\\n", group + b"-1-\\xc3", b"\\n@" + start + b"1-a..0.x"
for name in odd:
    take(socket.SOCK_STREAM, start + name, False)
    take(socket.SOCK_DGRAM, start + name, False)
print("ready", flush=True)
time.sleep(600)
"""
"""Has 900 names of masters that do not answer, every other one with a full queue, and some that are no text."""
CONNECTS = """
import os, socket, sys, time
path, address = sys.argv[1], b"\\0" + sys.argv[2].encode()
try:
    names = os.listdir(path)
except OSError:
    names = ["1-a.x.y.z"]
print("ready", flush=True)
until, count = time.monotonic() + 60, 0
while time.monotonic() < until:
    one = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    one.setblocking(False)
    try:
        one.connect(address if address[1:] else f"{path}/{names[0]}")
        one.send(b'{"do": "go"}\\n' * 20)
    except OSError:
        pass
    one.close()
    count += 1
    if count % 64 == 0:
        time.sleep(0.01)
"""
"""Connects for a minute at most and says GO, 64 times in a row: four times what the master listens to at once."""


@pytest.fixture
def folder() -> Iterator[Path]:
    """Where the victim's robot is, open to its user."""
    with tempfile.TemporaryDirectory(prefix="msbot-hostile-", dir="/var/tmp") as place:
        Path(place).chmod(0o755)
        (Path(place) / "robot.toml").write_text(SAMPLE_ROBOT_TOML)
        yield Path(place)


@pytest.fixture
def group() -> str:
    return os.environ["MSBOT_STOP_GROUP"]


def told(log: Path, words: str) -> None:
    until = time.monotonic() + PATIENCE_S
    while words not in log.read_text():
        assert time.monotonic() < until, log.read_text()
        time.sleep(0.02)


def says(user: int, *words: str) -> tuple[int, str, str]:
    """What a command of that user answers."""
    command = [sys.executable, "-m", "msbot", *words]
    before = [] if user == 0 else as_user(user, may_read=True)
    env = {**os.environ, "HOME": "/nonexistent", "LOGNAME": "daemon"}
    done = subprocess.run([*before, *command], capture_output=True, text=True, cwd="/", env=env, check=False)
    return done.returncode, done.stdout, done.stderr


def stopped_by(user: int) -> dict[str, Any]:
    """The answer to a STOP; the floods leave the robot little time, and it may be late, but nobody else is counted."""
    until = time.monotonic() + PATIENCE_S
    while True:
        status, out, error = says(user, "stop", "--json")
        assert "ROVER" not in error, error
        if status == 0:
            answer = json.loads(out)
            assert isinstance(answer, dict)
            return answer
        assert time.monotonic() < until, error


@contextmanager
def planted() -> Iterator[None]:
    """Everything that `nobody` has put into /tmp is removed in the end."""
    start = f"{SHARED_FOLDER}/{PREFIX}{VICTIM}"
    try:
        yield
    finally:
        for path in Path(SHARED_FOLDER).glob(f"{PREFIX}{VICTIM}*"):
            if path.lstat().st_uid == NOBODY:
                assert str(path).startswith(start)
                path.rmdir() if not path.is_symlink() and path.is_dir() else path.unlink()


def test_planted_folders_900_sockets_and_a_flood_keep_no_stop_away(folder: Path, group: str) -> None:
    start = f"{SHARED_FOLDER}/{PREFIX}{VICTIM}"
    with ExitStack() as stack:
        stack.enter_context(planted())
        if not Path(start).exists():
            stack.enter_context(attacker(PLANTS, start))
        log = stack.enter_context(master_of(VICTIM, folder, {}))
        told(log, "is up on")
        (own,) = (path for path in Path(SHARED_FOLDER).glob(f"{PREFIX}{VICTIM}*") if path.lstat().st_uid == VICTIM)
        stack.callback(remove, own)
        stack.enter_context(attacker(LISTENS, f"{PREFIX}{VICTIM}-", group))
        for _ in range(2):
            stack.enter_context(attacker(CONNECTS, str(own), ""))
        out = stopped_by(VICTIM)
        assert [(one["robot"], one["stopped"]) for one in out["robots"]] == [("MSBOT_MASTER", True)]
        assert out["not_reached"] == []
        assert json.loads(says(VICTIM, "stop", "--status", "--json")[1])["stopped"], "nobody's GO was heard"
        until = time.monotonic() + PATIENCE_S
        while "MSBOT_MASTER X100Y100Z100 of user daemon: STOP holds" not in (words := says(0, "stop")[1]):
            assert time.monotonic() < until, words  # the flood leaves the robot little time
        assert "STOP is over" in says(0, "go")[1]


def test_without_a_folder_the_abstract_name_is_refused_to_others(folder: Path, group: str) -> None:
    """The master sees file systems on which nothing can be made; whoever says STOP finds it by its name."""
    nothing = "mount -t tmpfs -o ro,mode=755 none"
    around = ("unshare", "-m", "sh", "-c", f'{nothing} /run && {nothing} /tmp && exec "$@"', "sh")
    with ExitStack() as stack:
        log = stack.enter_context(master_of(VICTIM, folder, {"TMPDIR": str(folder / "own")}, around=around))
        told(log, "it has a name without one")
        told(log, "is up on")
        (name,) = abstract(group)
        stack.enter_context(attacker(LISTENS, f"{PREFIX}{VICTIM}-", group))
        for _ in range(2):
            stack.enter_context(attacker(CONNECTS, "/nonexistent", name))
        for user in (VICTIM, 0):
            out = stopped_by(user)
            assert [one["stopped"] for one in out["robots"]] == [True]
        assert json.loads(says(VICTIM, "stop", "--status", "--json")[1])["stopped"], "nobody's GO was heard"


def abstract(group: str) -> list[str]:
    octets = Path("/proc/net/unix").read_bytes().splitlines()
    found = [line.rpartition(b" @")[2].decode() for line in octets if f".{group}.".encode() in line]
    return [name for name in found if name.startswith(f"{PREFIX}{VICTIM}-")]


def remove(folder: Path) -> None:
    """What a killed master has left."""
    for path in folder.iterdir():
        path.unlink()
    folder.rmdir()

"""What others leave under a name: a pipe nobody writes to, a socket, a folder, a device, octets that are no text.

Every command that reads a file ends with one sentence about it, and does not wait for it.
"""

from __future__ import annotations

import ctypes
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from msbot.doctor.collectors.machine_facts import command_line_of, running_programs
from msbot_agent.cli import msbot
from msbot_agent.idl.model import Definitions
from msbot_agent.idl.omg_reader import read_idl
from msbot_agent.text.untrusted_input import open_input_file, open_input_text, read_system_file
from msbot_xrce.errors import ConfigError
from tests.e2e.processes import run

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="another system has other things than files")

READS = {
    "demo certificate": ["demo", "--certificate", "FILE"],
    "demo certificate_key": ["demo", "--certificate", "FILE", "--certificate-key", "FILE"],
    "master blueprint": ["master", "FILE"],
    "master folders": ["master", "good.toml", "--library", "FILE"],
    "master certificate": ["master", "good.toml", "--port", "0", "--certificate", "FILE"],
    "master certificate_key": ["master", "good.toml", "--certificate", "FILE", "--certificate-key", "FILE"],
    "master home_assistant_password": [
        "master",
        "good.toml",
        "--home-assistant",
        "mqtt://127.0.0.1:1",
        "--home-assistant-password",
        "FILE",
    ],
    "part folders": ["part", "ABCD", "--library", "FILE"],
    "host path": ["host", "FILE"],
    "host folders": ["host", "good.toml", "--library", "FILE"],
    "board file": ["board", "run", "FILE", "--port", "/dev/null"],
    "hardware folders": ["hardware", "scan", "--library", "FILE"],
    "library paths": ["library", "check", "FILE"],
    "library folders": ["library", "list", "--library", "FILE"],
    "check blueprint": ["check", "FILE"],
    "check folders": ["check", "good.toml", "--library", "FILE"],
    "diff blueprint": ["diff", "FILE"],
    "diff folders": ["diff", "good.toml", "--library", "FILE"],
    "apply blueprint": ["apply", "FILE"],
    "apply folders": ["apply", "good.toml", "--library", "FILE"],
    "slot blueprint": ["slot", "add", "A", "ABCD", "--blueprint", "FILE"],
    "slot folders": ["slot", "add", "A", "ABCD", "--blueprint", "good.toml", "--library", "FILE"],
    "class blueprint": ["class", "apply", "FILE"],
    "class folders": ["class", "apply", "good.toml", "--library", "FILE"],
    "user path": ["user", "add", "--list", "FILE"],
    "pupils source": ["pupils", "robot", "made.toml", "--from", "FILE"],
    "pupils folders": ["pupils", "robot", "made.toml", "--from", "good.toml", "--library", "FILE"],
    "service blueprint": ["service", "install", "FILE"],
    "db file": ["db", "restore", "FILE"],
    "log before": ["log", "diff", "FILE", "FILE"],
    "log after": ["log", "diff", "FILE", "FILE"],
    "log file": ["log", "show", "FILE"],
    "play file": ["play", "FILE"],
    "plot folders": ["plot", "--library", "FILE"],
    "mission file": ["mission", "check", "FILE"],
    "mission recording": ["mission", "report", "--recording", "FILE"],
    "lesson path": ["lesson", "check", "FILE"],
    "idl file": ["idl", "to-python", "FILE"],
    "explain blueprint": ["explain", "103#C181000A", "--blueprint", "FILE"],
    "explain folders": ["explain", "103#C181000A", "--library", "FILE"],
    "bus blueprint": ["bus", "decode", "--blueprint", "FILE"],
    "bus folders": ["bus", "load", "nothing.log", "--library", "FILE"],
    "agent refs": ["agent", "udp4", "--refs", "FILE"],
    "agent list_file": ["agent", "multiserial", "-f", "FILE"],
    "gateway file": ["gateway", "FILE"],
    "router file": ["router", "FILE"],
}
"""What reads a file or a folder of files, by command and parameter: the words of a call, and FILE."""
WRITES = {
    "log", "db", "svg", "folder", "picture", "tickets", "backups", "target", "out", "html", "rec", "wireshark",
    "init path", "export file", "rec file", "pupils path", "doctor file",
}  # fmt: skip
"""Parameters that name what is written, which is refused if it exists or never read; of one command, or of all."""
FOLDERS = {"lessons", "include", "go_on"}
"""Parameters for which the command line takes a folder only."""


def parameters(command: click.Command, context: click.Context, first: str = "") -> Iterator[tuple[str, str]]:
    """The first word and the parameter of everything that takes the name of a file."""
    if isinstance(command, click.Group):
        for name in command.list_commands(context):
            found = command.get_command(context, name)
            assert found is not None
            yield from parameters(found, click.Context(found, parent=context, info_name=name), first or name)
        return
    for one in command.params:
        if isinstance(one.type, click.Path) and one.name is not None:
            yield first, one.name


def test_every_command_that_takes_a_file_is_tried_here() -> None:
    all_of_them = set(parameters(msbot, click.Context(msbot)))
    missing = {
        f"{first} {name}"
        for first, name in all_of_them
        if f"{first} {name}" not in READS and not {name, f"{first} {name}"} & WRITES and name not in FOLDERS
    }
    assert missing == set()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one file of every odd kind."""
    found = tmp_path_factory.mktemp("odd")
    os.mkfifo(found / "pipe.toml")
    (found / "folder.toml").mkdir()
    (found / "octets.toml").write_bytes(b"\xff\xfe\0\x80")
    (found / "loop.toml").symlink_to(found / "loop.toml")
    (found / "good.toml").write_text('[robot]\nname = "R"\n[[slot]]\nname = "AA"\npart = "ABCD"\n')
    here = os.getcwd()
    os.chdir(found)  # the name of a socket is short
    with socket.socket(socket.AF_UNIX) as one:
        one.bind("socket.toml")
    os.chdir(here)
    return found


@pytest.mark.parametrize("words", READS.values(), ids=READS)
def test_a_pipe_nobody_writes_to_is_refused_and_not_waited_for(words: list[str], folder: Path) -> None:
    done = run(*(word.replace("FILE", "pipe.toml") for word in words), cwd=folder)
    assert done.returncode in (1, 2), (done.returncode, done.stdout, done.stderr)
    assert "Traceback" not in done.stderr
    assert done.stderr.count("\n") <= 4, done.stderr


@pytest.mark.parametrize("name", ["folder.toml", "octets.toml", "loop.toml", "socket.toml", "/dev/ptmx", "/dev/full"])
@pytest.mark.parametrize("command", ["check blueprint", "log file", "user path", "idl file", "lesson path"])
def test_what_is_no_file_of_that_kind_is_one_sentence(command: str, name: str, folder: Path) -> None:
    done = run(*(word.replace("FILE", name) for word in READS[command]), cwd=folder)
    assert done.returncode in (1, 2), (done.returncode, done.stdout, done.stderr)
    assert "Traceback" not in done.stderr
    assert done.stderr.count("\n") <= 4, done.stderr


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("pipe.toml", "a pipe"),
        ("folder.toml", "folder"),
        ("socket.toml", "a socket"),
        ("/dev/ptmx", "a device"),
        ("nul\0.toml", "no file can have that name"),
        ("half\ud800", "no file can have that name"),
        ("loop.toml", "symbolic"),
        ("gone.toml", "No such file"),
    ],
)
def test_what_a_name_stands_for_is_said(name: str, words: str, folder: Path) -> None:
    with pytest.raises(OSError, match=words):
        open_input_file(folder / name)
    with pytest.raises(OSError, match=words):
        open_input_text(folder / name)


def test_a_pipe_that_the_person_connects_is_read_to_its_end() -> None:
    reading, writing = os.pipe()
    with os.fdopen(writing, "wb") as stream:
        stream.write(b"text")
    with open_input_file(Path(f"/dev/fd/{reading}")) as given:
        assert given.read() == b"text"
    os.close(reading)


def test_an_included_file_whose_name_can_be_none_is_a_mistake_in_that_line(tmp_path: Path) -> None:
    for name in ("a\0b.idl", "half\ud800.idl"):
        with pytest.raises(ConfigError, match=r"x\.idl:1:1: .*no file can have that name"):
            read_idl(f'#include "{name}"\n', str(tmp_path / "x.idl"), Definitions())


def test_programs_with_names_that_are_no_text_are_seen_and_harm_nobody() -> None:
    """Anybody may start one: the octets of a name, of its command line and of its environment are theirs to choose."""
    odd = "import ctypes,sys; ctypes.CDLL(None).prctl(15, b'\\xff\\x1b[31m\\n'); print(1, flush=True); sys.stdin.read()"
    assert ctypes.CDLL(None) is not None
    words = [os.fsencode(sys.executable), b"-c", odd.encode(), b"\xff\x1b[2J", b"x" * 100_000]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env={b"\xff": b"\xfe"}) as process:
        assert process.stdout is not None
        process.stdout.readline()
        names = dict(running_programs())
        assert names[process.pid].isprintable()
        assert command_line_of(process.pid).isprintable()
        assert read_system_file(f"/proc/{process.pid}/environ") == "\ufffd=\ufffd\0"
        assert process.stdin is not None
        process.stdin.close()
        process.wait()
    with pytest.raises(OSError, match="No such"):
        read_system_file(f"/proc/{process.pid}/comm")

"""Processes of `msbot` that begin with their modules loaded: copies of a prepared process, made by `fork`.

Importing a web server and a database takes a command seconds, and the tests start hundreds of commands. Here one
process beside each process of pytest imports what a command will import, reads the part types that MsBOT brings, and
forks; the copy goes on as `python -m msbot` would: with its own arguments, folder, environment, output and exit status.
`MSBOT_REAL_PROCESSES=1` starts every command from nothing; so does an environment that changes how Python starts.

Run as a program, this file is the prepared process: requests come in at the socket whose number is its argument.
"""

from __future__ import annotations

import atexit
import ctypes
import gc
import importlib
import io
import json
import os
import runpy
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import cache
from itertools import pairwise
from pathlib import Path
from threading import Lock
from typing import IO, TypeAlias

MSBOT = (sys.executable, "-m", "msbot")
REAL = "MSBOT_REAL_PROCESSES"
NETWORK = "MSBOT_TEST_NETWORK"
"""In the environment of a command: the name of the network that it shall run in (`tests.networks`)."""
GROUP = "MSBOT_STOP_GROUP"
NEW_NETWORK = 0x40000000
"""CLONE_NEWNET of setns(2)."""
LARGEST = 1 << 20
"""Octets of a request: arguments and environment."""
ROBOT = (
    "msbot.operations.dispatch",
    "msbot.registry.registry",
    "msbot_agent.link.link_schemes",
    "msbot_agent.agent.server",
)
NEEDS = {
    "demo": (*ROBOT, "msbot_school.demo"),
    "master": (*ROBOT, "msbot.master"),
    "part": ("msbot.sim", "msbot_agent.link.link_schemes"),
    "host": ("msbot.sim", "msbot.hardware", "msbot_agent.link.link_schemes"),
}
"""What a command imports when it runs, besides its own module."""
PAGE = "msbot_web.assembly"
STARTS = ("PYTHON", "LC_", "LANG", "LD_PRELOAD")
"""What changes how Python starts begins with one of these."""
Wish: TypeAlias = tuple[list[str], str, dict[str, str], tuple[int, int] | None]
"""Arguments, folder, environment and limits of a command."""
_TURN = Lock()
"""Commands may be started by several threads; there is one prepared process."""


def start(
    arguments: Sequence[str],
    *,
    cwd: Path | None,
    env: Mapping[str, str],
    stdout: IO[bytes] | int,
    stderr: IO[bytes] | int,
    limits: tuple[int, int] | None = None,
) -> subprocess.Popen[bytes] | Copy:
    """Start `msbot` with these arguments; the system ends it beyond its limits: processor seconds, octets of memory."""
    assert_no_stop_for_all(arguments, env)
    changed = {name for name in {*env, *os.environ} if env.get(name) != os.environ.get(name)} - {"PYTHONUNBUFFERED"}
    if sys.platform != "linux" or REAL in env or any(name.startswith(STARTS) for name in changed):
        there = ["ip", "netns", "exec", env[NETWORK]] if NETWORK in env else []
        process = subprocess.Popen(
            [*there, *MSBOT, *arguments], cwd=cwd, env=dict(env), stdout=stdout, stderr=stderr, stdin=subprocess.DEVNULL
        )
        if limits is not None:
            _limit(process.pid, *limits)
        return process
    out, error = (stream if isinstance(stream, int) else stream.fileno() for stream in (stdout, stderr))
    with _TURN:
        prepared = _prepared()
    return prepared.copy((list(arguments), str(cwd or Path.cwd()), dict(env), limits), out, error)


def assert_no_stop_for_all(arguments: Sequence[str], env: Mapping[str, str]) -> None:
    """A STOP for no group reaches every robot of the user, also those of other workers and of people: their sockets are
    in one folder, whatever network and folders of its own a command has."""
    groups = [after for word, after in pairwise(arguments) if word == "--stop-group"] or [env.get(GROUP, "")]
    assert all(groups), f"{' '.join(arguments)} would stop every robot on this computer: give it a STOP group"


@cache
def _prepared() -> Prepared:
    made = Prepared()
    atexit.register(made.leave)  # or Python complains of its socket and its process when the tests are over
    return made


class Prepared:
    """The prepared process; it ends when this one does, whatever ends it, and its copies with it."""

    def __init__(self) -> None:
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            theirs.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, LARGEST)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, LARGEST)
            command = [sys.executable, __file__, str(theirs.fileno())]
            self._process = subprocess.Popen(command, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL)

    def leave(self) -> None:
        """Say that no more will be asked of it, as the system does when this process is gone."""
        self._socket.close()
        self._process.wait()

    def copy(self, wish: Wish, out: int, error: int) -> Copy:
        """A copy that runs a command."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
        with theirs:
            socket.send_fds(self._socket, [json.dumps(wish).encode()], [theirs.fileno(), out, error])
        return Copy(wish[0], ours)


class Copy:
    """One running command, with the part of `subprocess.Popen` that the tests use."""

    def __init__(self, arguments: Sequence[str], status: socket.socket) -> None:
        self.args = list(arguments)
        self.returncode: int | None = None
        self._news = status.makefile("r")
        self._status = status
        line = self._news.readline()
        assert line, "the prepared process has ended"
        self.pid = int(line)

    def wait(self, timeout: float | None = None) -> int:
        """The exit status, as `subprocess` has it."""
        if self.returncode is None:
            if not select.select([self._status], [], [], timeout)[0]:
                raise subprocess.TimeoutExpired(self.args, timeout or 0)
            line = self._news.readline()
            assert line, "the prepared process has ended"
            self.returncode = int(line)
            self.forget()
        return self.returncode

    def poll(self) -> int | None:
        """The exit status; None: it still runs."""
        with suppress(subprocess.TimeoutExpired):
            self.wait(0)
        return self.returncode

    def send_signal(self, number: signal.Signals) -> None:
        """Send a signal, unless it has ended."""
        if self.poll() is None:
            with suppress(ProcessLookupError):  # it has ended in this very moment
                os.kill(self.pid, number)

    def kill(self) -> None:
        """End it without asking."""
        self.send_signal(signal.SIGKILL)

    def forget(self) -> None:
        """Ask no more how it ended."""
        self._news.close()
        self._status.close()


def _serve(requests: socket.socket) -> tuple[Wish, list[int]] | None:
    """Fork for every request; returns in each copy what it shall do, and None in this process at the end."""
    running: dict[int, socket.socket] = {}
    wake, poke = os.pipe()
    os.set_blocking(poke, False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(poke, warn_on_full_buffer=False)
    while True:
        ready, _, _ = select.select([requests.fileno(), wake], [], [])
        if wake in ready:
            os.read(wake, 4096)
            _tell_ends(running)
        if requests.fileno() not in ready:
            continue
        data, files, _, _ = socket.recv_fds(requests, LARGEST, 3)
        if not data:  # pytest has ended, or was ended: nobody else would end what still runs
            for pid in running:
                os.kill(pid, signal.SIGKILL)
            return None
        wish: Wish = json.loads(data)
        _prepare(wish[0])
        status = socket.socket(fileno=files[0])
        pid = os.fork()
        if pid == 0:
            signal.set_wakeup_fd(-1)
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            for opened in (requests, status, *running.values()):
                opened.close()
            os.close(wake)
            os.close(poke)
            return wish, files[1:]
        for file in files[1:]:
            os.close(file)
        running[pid] = status
        status.sendall(f"{pid}\n".encode())


def _tell_ends(running: dict[int, socket.socket]) -> None:
    while running:
        pid, status = os.waitpid(-1, os.WNOHANG)
        if pid == 0:
            return
        with running.pop(pid) as asker, suppress(BrokenPipeError):  # nobody wants to know
            asker.sendall(f"{os.waitstatus_to_exitcode(status)}\n".encode())


def _prepare(arguments: Sequence[str]) -> None:
    """Import what a command with these arguments will import."""
    from msbot_agent.cli import BUILT_IN
    from msbot_agent.startup.extensions import installed

    word = arguments[0] if arguments else ""
    known = {name: f"msbot_agent.cli.{module}" for name, module in BUILT_IN.items()}
    # Those of others are found when a copy looks for them, perhaps with another path.
    known |= {one.name: one.target.partition(":")[0] for one in installed() if one.group == "commands" and one.is_own}
    if word not in known:
        return
    names = [known[word], *NEEDS.get(word, ())]
    if word in ("demo", "master") and not {"--no-page", "--help"} & {*arguments}:
        names.append(PAGE)
    before = len(sys.modules)
    for name in names:
        importlib.import_module(name)
    if "msbot.config" in sys.modules:
        from msbot.config import load_library

        load_library()  # what MsBOT brings is read once in a process
    if len(sys.modules) > before:
        gc.collect()
        gc.freeze()  # the copies share these objects with each other: none is looked at again
    assert len(os.listdir("/proc/self/task")) == 1, f"{names} start threads, which are not copied"


def _limit(pid: int, processor_s: int, memory: int) -> None:
    """Limit a process (0: this one) to some processor time, and to some memory beyond what it has now."""
    import resource

    taken = int(Path(f"/proc/{pid or 'self'}/statm").read_text().split()[0]) * resource.getpagesize()
    resource.prlimit(pid, resource.RLIMIT_CPU, (processor_s, processor_s + 1))
    resource.prlimit(pid, resource.RLIMIT_AS, (taken + memory, taken + memory))


def _enter(network: str) -> None:
    """Move this process into a network."""
    with Path("/run/netns", network).open() as there:
        if ctypes.CDLL(None, use_errno=True).setns(there.fileno(), NEW_NETWORK):
            raise OSError(ctypes.get_errno(), f"cannot enter the network {network}")


def become(wish: Wish, files: list[int]) -> None:
    """Run the command in this copy of a process, as if the interpreter had just been started with `-m msbot`."""
    arguments, folder, environment, limits = wish
    if limits is not None:
        _limit(0, *limits)
    if NETWORK in environment:
        _enter(environment.pop(NETWORK))
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    for number, file in enumerate(files, start=1):
        os.dup2(file, number)
    for file in {*files} - {1, 2}:
        os.close(file)
    unbuffered = bool(environment.get("PYTHONUNBUFFERED"))
    encoding, errors = sys.stdout.encoding, sys.stdout.errors
    out, error = (os.fdopen(number, "wb", 0 if unbuffered else -1, closefd=False) for number in (1, 2))
    sys.stdout = io.TextIOWrapper(out, encoding, errors, write_through=unbuffered)
    sys.stderr = io.TextIOWrapper(error, encoding, "backslashreplace", line_buffering=True, write_through=unbuffered)
    sys.path[0] = folder
    sys.argv[1:] = arguments
    runpy.run_module("msbot", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    with socket.socket(fileno=int(sys.argv[1])) as requests:
        wish = _serve(requests)
    if wish is not None:
        become(*wish)

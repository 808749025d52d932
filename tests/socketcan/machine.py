"""Runs chosen tests inside virtual machines with SocketCAN, once per test session, beside the other tests.

Theory of operation. Every worker of the session has collected the same tests. The first one that can make the run's
folder starts this file as a process of its own, which runs one machine after the other; a machine runs pytest on the
tests that want it and keeps its reports. The process holds a lock from before its start to its end: whoever needs a
result waits for the lock, then reads the reports.

An emulated machine sometimes hangs or dies while it boots. One that says nothing new for a while is switched off, and
another one runs the tests that are still without a report.
"""

from __future__ import annotations

import fcntl
import os
import pickle
import platform
import select
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from tests.firmware.building import linux_board

ROOT = Path(__file__).parent.parent.parent
RUNNER = ROOT / "tools" / "run-in-vm.sh"
REPORT = "MSBOT_VM_REPORT"
"""Environment variable: where pytest inside a machine puts its reports."""
PATIENCE_S = 3600
"""A machine that is not done after this time is switched off."""
TEST_S = 900
"""A test that hangs is ended after this time; one that only waits has failed before, and says for what it waited."""
SILENCE_S = 960
"""A machine that has reported nothing for this time is switched off, too."""
STARTS = 3
"""A machine is started this many times while tests are without a report."""
NOT_STARTED = 125
"""Exit status of the runner when the machine did not start or died."""
PLUGINS = (
    "pytest_asyncio.plugin",
    "pytest_timeout",
    "tests.time_of_a_test",
    "no:cacheprovider",
    "no:legacypath",
    "no:doctest",
)
"""Only what these tests need: modules load slowly there."""


MACHINES = {"uml": (), "qemu": ("-c", "both")}
"""Options of the runner for each machine: `uml` is quick, `qemu` has controllers."""


def why_not(name: str) -> str | None:
    """Why there is no machine of that name here; None when there is one."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        return "a virtual machine with SocketCAN needs Linux on x86-64"
    if subprocess.run([RUNNER, "--ready", name], check=False).returncode:
        return f"no virtual machine with SocketCAN is prepared: `make vm ENGINE={name}` does it once"
    return None


class MachineRun:
    """The machines of one test session."""

    def __init__(self, folder: Path) -> None:
        """Use a folder that all workers of the session share."""
        self._folder = folder
        self._process: subprocess.Popen[bytes] | None = None
        self._reports: dict[str, list[dict[str, object]]] | None = None

    def start(self, tests: Mapping[str, Sequence[str]]) -> None:
        """Start the machines unless another worker did: which tests on which machine."""
        staging = self._folder.with_name(f"{self._folder.name}-{os.getpid()}")
        staging.mkdir()
        for machine, names in tests.items():
            (staging / machine).mkdir()
            (staging / machine / "tests").write_text("".join(f"{name}\n" for name in names))
        with open(staging / "lock", "wb") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            with suppress(OSError):  # not empty: another worker was first
                staging.rename(self._folder)
                command = [sys.executable, "-m", "tests.socketcan.machine", str(self._folder)]
                self._process = subprocess.Popen(command, pass_fds=[lock.fileno()], cwd=ROOT, stdin=subprocess.PIPE)

    def finish(self) -> None:
        """Wait for the machines if this worker has started them."""
        if self._process is not None:
            self._process.wait()
            assert self._process.stdin is not None
            self._process.stdin.close()

    def reports(self, name: str) -> list[dict[str, object]]:
        """The reports of one test, as pytest serialises them; waits until the machines are done."""
        if self._reports is None:
            with open(self._folder / "lock", "rb") as lock:
                fcntl.flock(lock, fcntl.LOCK_SH)
            self._reports = {}
            for path in self._folder.glob("*/reports"):
                for report in _read(path):
                    self._reports.setdefault(str(report["nodeid"]), []).append(report)
        return self._reports.get(name, [])

    def failure(self, machine: str) -> tuple[bool, str]:
        """Why a test of that machine has no reports: whether it did not even start, and its last words."""
        folder = self._folder / machine
        status = int((folder / "status").read_text())
        words = (folder / "output").read_text(errors="replace").strip()
        return status == NOT_STARTED and not (folder / "reports").exists(), words


def _read(path: Path) -> Iterator[dict[str, object]]:
    with open(path, "rb") as file, suppress(EOFError, pickle.UnpicklingError):
        while True:
            yield pickle.load(file)


def _run_machine(folder: Path) -> None:
    """Run one machine's tests; leaves `reports`, `output` and `status` in its folder."""
    names = [name for name in os.environ if not name.startswith("PYTEST_")]
    environment = {name: os.environ[name] for name in names} | {REPORT: str(folder / "reports")}
    environment["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    plugins = [word for name in PLUGINS for word in ("-p", name)]
    pytest = [
        sys.executable,
        "-m",
        "pytest",
        *plugins,
        f"--timeout={TEST_S}",
        "--confcutdir=tests/socketcan",
        f"@{folder / 'tests'}",
    ]
    command = [str(RUNNER), *MACHINES[folder.name], "-t", str(PATIENCE_S), "-w", str(folder), "--", *pytest]
    for start in range(1, STARTS + 1):
        with open(folder / "output", "wb") as output:
            runner = subprocess.Popen(
                command, cwd=ROOT, env=environment, stdin=subprocess.DEVNULL, stdout=output, stderr=output
            )
            fell_silent = _watch(runner, folder / "reports")
            if fell_silent:
                output.write(f"switched off at start {start}: no test reported for {SILENCE_S} s\n".encode())
        (folder / "status").write_text(str(runner.returncode))
        left = _without_report(folder)
        if not left or not (fell_silent or runner.returncode == NOT_STARTED):
            return
        (folder / "tests").write_text("".join(f"{name}\n" for name in left))


def _watch(runner: subprocess.Popen[bytes], reports: Path) -> bool:
    """Wait for the machine's end; switch it off, and say so, when it falls silent.

    Raises:
        SystemExit: the tests were ended, with whatever they had of this process' standard input; the machine is off.
    """
    said = -1
    ended = os.pidfd_open(runner.pid)
    try:
        while True:
            ready, _, _ = select.select([ended, sys.stdin], [], [], SILENCE_S)
            if ended in ready:
                runner.wait()
                return False
            now = reports.stat().st_size if reports.exists() else 0
            silent = now == said or (said < 0 and now == 0)
            if ready or silent:
                runner.terminate()  # its trap ends the machine, too
                runner.wait()
                if ready:
                    sys.exit("the tests have ended")
                return True
            said = now
    finally:
        os.close(ended)


def _without_report(folder: Path) -> list[str]:
    """The tests that have not come to their end, in their order."""
    path = folder / "reports"
    ended = {report["nodeid"] for report in _read(path) if report["when"] == "teardown"} if path.exists() else set()
    return [name for name in (folder / "tests").read_text().splitlines() if name not in ended]


def _compile(tests: str) -> None:
    """Compile what they run out here, where compilers are quick: a machine sees all files, those of `kept`, too."""
    if "test_firmware" in tests and shutil.which("gcc"):
        with suppress(AssertionError):  # the test compiles it again and tells what is wrong
            linux_board()


if __name__ == "__main__":
    for machine in MACHINES:
        if (Path(sys.argv[1]) / machine).exists():
            _compile((Path(sys.argv[1]) / machine / "tests").read_text())
            _run_machine(Path(sys.argv[1]) / machine)

"""Runs pytest again and again in copies of one process that has all but `msbot` loaded, which saves seconds each.

Reads a request on each line of its input, `{"source": FOLDER, "tests": [...], "seconds": N, "output": FILE}`, runs
these tests with the `msbot` of that folder, and answers with the exit status on a line: that of pytest, or minus the
signal that ended it.
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import signal
import sys
import time
import traceback
from pathlib import Path

LOADED = (
    "pytest", "_pytest.main", "hypothesis", "hypothesis.strategies", "pytest_asyncio", "pytest_timeout", "asyncio",
    "sqlalchemy", "sqlalchemy.dialects.sqlite", "alembic.command", "alembic.autogenerate", "can", "websockets", "click",
    "rich.console", "dpkt", "zstandard", "mcap.writer",
)  # fmt: skip
FLAGS = ("-n0", "-x", "-q", "-p", "no:cacheprovider", "-p", "no:schemathesis", "-p", "no:anyio", "--timeout", "300",
         "-W", "ignore::pytest.PytestAssertRewriteWarning")  # fmt: skip
PATIENCE_S = 600.0
"""Real seconds after which a run counts as one that never ends."""
IDLE_S = 60.0
"""The same for a run that does nothing at all."""
FELL = 70
"""Exit status when pytest itself ends in an error."""


def main() -> None:
    """Serve until the input ends."""
    for name in LOADED:
        importlib.import_module(name)
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGCHLD])
    answers = os.fdopen(os.dup(1), "w")
    for line in sys.stdin:
        request = json.loads(line)
        child = os.fork()
        if child == 0:
            _run(request)
        if not _ends(child):
            os.killpg(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        answers.write(f"{os.waitstatus_to_exitcode(status)}\n")
        answers.flush()


def _ends(child: int) -> bool:
    """Wait for its end, as long as it does something."""
    end = time.monotonic() + PATIENCE_S
    used = -1.0
    while time.monotonic() < end:
        if signal.sigtimedwait([signal.SIGCHLD], IDLE_S) is not None:
            return True
        before, used = used, _used_s(child)
        if used - before < IDLE_S / 1000:
            return False
    return False


def _used_s(process: int) -> float:
    """Its processor seconds so far, with those of its own that have ended."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def _run(request: dict[str, object]) -> None:
    """In the copy; does not return."""
    code = FELL
    try:
        os.setsid()
        signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGCHLD])
        output = os.open(str(request["output"]), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(output, 1)
        os.dup2(output, 2)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        seconds = int(str(request["seconds"]))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
        source = str(request["source"])
        assert not any(name.partition(".")[0] == "msbot" for name in sys.modules)
        sys.path.insert(0, source)
        os.environ["PYTHONPATH"] = f"{source}:{Path.cwd()}"
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
        sys.dont_write_bytecode = True
        import pytest

        tests = request["tests"]
        assert isinstance(tests, list)
        code = int(pytest.main([*FLAGS, *tests]))
        sys.stdout.flush()
    except BaseException:
        traceback.print_exc()
        raise
    finally:
        os._exit(code)


if __name__ == "__main__":
    main()

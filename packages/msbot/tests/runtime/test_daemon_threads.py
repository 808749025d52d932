"""Threads that nobody waits for."""

from __future__ import annotations

import subprocess
import sys
from threading import Event, Thread

import pytest

from msbot.process.daemon_threads import DaemonThreads

PATIENCE_S = 60
HANGS = """
from threading import Event
from msbot.process.daemon_threads import DaemonThreads
threads = DaemonThreads(1, "hangs")
begun = Event()
threads.submit(lambda: (begun.set(), Event().wait()))
begun.wait()
threads.shutdown()
print("ends")
"""


def test_a_process_ends_though_a_thread_hangs() -> None:
    done = subprocess.run([sys.executable, "-c", HANGS], capture_output=True, timeout=PATIENCE_S, check=False)
    assert (done.returncode, done.stdout.split()) == (0, [b"ends"]), done.stderr


def test_results_errors_and_cancelled_work_are_told_and_no_more_threads_than_asked_for_work() -> None:
    threads, go = DaemonThreads(2, "some"), Event()
    at_work: list[int] = []

    def begin() -> bool:
        at_work.append(1)
        return go.wait(PATIENCE_S)

    waiting = [threads.submit(begin) for _ in range(3)]
    late = threads.submit(at_work.clear)
    assert late.cancel()
    wrong = threads.submit(int, "x")
    assert not wrong.done()
    go.set()
    with pytest.raises(ValueError, match="invalid literal"):
        wrong.result(PATIENCE_S)
    assert [one.result(PATIENCE_S) for one in waiting] == [True] * 3
    assert at_work == [1, 1, 1]
    threads.shutdown()
    with pytest.raises(RuntimeError, match="nothing is done any more"):
        threads.submit(int)


def test_a_thread_that_the_system_refuses_now_is_started_next_time(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: Thread) -> None:
        raise RuntimeError("can't start new thread")

    threads = DaemonThreads(1, "refused")
    with monkeypatch.context() as exhausted:
        exhausted.setattr(Thread, "start", refuse)
        with pytest.raises(RuntimeError):
            threads.submit(int)
    assert threads.submit(lambda: 5).result(PATIENCE_S) == 5
    threads.shutdown()

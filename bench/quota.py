"""Lets a process have a part of a processor only, as on a smaller computer: by a control group, or by stopping it."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

PERIOD_S = 0.01
"""Short, because a slower computer is slower all the time, and does not stand still now and then."""
_GROUPS = Path("/sys/fs/cgroup")


@contextlib.contextmanager
def limited(pids: Sequence[int], share: float) -> Iterator[str]:
    """Give these processes together that share of one core; yields how, in words."""
    group = _make_group(share)
    if group is not None:
        for pid in pids:
            (group / "cgroup.procs").write_text(str(pid))
        try:
            yield "control group"
        finally:
            for line in (group / "cgroup.procs").read_text().split():
                with contextlib.suppress(OSError):  # it has ended
                    (group.parent / "cgroup.procs").write_text(line)
            with contextlib.suppress(OSError):
                group.rmdir()
        return
    command = [sys.executable, "-m", "bench.quota", str(share), *map(str, pids)]
    with subprocess.Popen(command) as holder:
        try:
            yield "SIGSTOP"
        finally:
            holder.terminate()
            holder.wait()


def _make_group(share: float) -> Path | None:
    """A control group with that quota; None where none can be made."""
    quota, period = round(share * PERIOD_S * 1e6), round(PERIOD_S * 1e6)
    name = f"msbot_bench_{os.getpid()}"
    for root, settings in (
        (_GROUPS / "cpu", (("cpu.cfs_period_us", str(period)), ("cpu.cfs_quota_us", str(quota)))),
        (_GROUPS, (("cpu.max", f"{quota} {period}"),)),
    ):
        group = root / name
        try:
            group.mkdir()
        except OSError:
            continue
        try:
            for file, text in settings:
                (group / file).write_text(text)
        except OSError:
            group.rmdir()
            continue
        return group
    return None


def _stop_and_go(share: float, pids: Sequence[int]) -> None:
    """Let the processes run for their share of each period only, until told to end."""
    over = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: over.set())
    try:
        while not over.is_set():
            for number, span in ((signal.SIGCONT, share), (signal.SIGSTOP, 1 - share)):
                for pid in pids:
                    os.kill(pid, number)
                time.sleep(span * PERIOD_S)
    except ProcessLookupError:
        return
    finally:
        for pid in pids:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGCONT)


if __name__ == "__main__":
    _stop_and_go(float(sys.argv[1]), [int(word) for word in sys.argv[2:]])

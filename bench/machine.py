"""The machine that figures were taken on, in one line."""

from __future__ import annotations

import os
import platform
import time
from pathlib import Path


def describe_machine() -> str:
    """Processor, number of cores, kernel, Python."""
    cores = os.cpu_count() or 1
    return f"{_processor()}, {cores} cores, {platform.system()} {platform.release()}, {_python()}"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


def _python() -> str:
    return f"{platform.python_implementation()} {platform.python_version()}"


def cpu_s(pid: int) -> float:
    """Processor seconds of a process so far, of all its threads; to the nanosecond, as `clock_getcpuclockid(3)`.

    Raises:
        OSError: there is no such process.
    """
    return time.clock_gettime(~pid << 3 | 2)

"""What a machine has done with its time, for a test that failed in it: whether it stood still, was busy, or had another
time than the computer outside."""

from __future__ import annotations

import os
import time
from glob import glob
from pathlib import Path

TICK_S = 1 / os.sysconf("SC_CLK_TCK")
MOST_PROCESSES = 12
KERNEL_LINES = 30
CLOCK = Path("/sys/class/rtc/rtc0/since_epoch")
"""The computer's time outside, in whole seconds, where the machine has such a clock."""


def state_of_machine() -> str:
    """In lines: its time, its processors, the processes that used most of them, and the kernel's last words."""
    lines = [f"up, idle: {_read('/proc/uptime')} s; load {_read('/proc/loadavg')}"]
    if CLOCK.exists():
        lines.append(
            f"its clock is {time.time() - int(_read(str(CLOCK))):.1f} s before the time outside (0 to 1: right)"
        )
    for line in _read("/proc/stat").splitlines():
        name, *ticks = line.split()
        if name.startswith("cpu"):
            user, nice, system, idle, io, irq, soft, steal = (int(tick) * TICK_S for tick in ticks[:8])
            lines.append(
                f"{name}: programs {user + nice:.1f} s, kernel {system:.1f} s, interrupts {irq + soft:.1f} s, idle "
                f"{idle + io:.1f} s, stolen {steal:.1f} s"
            )
    processes = sorted(filter(None, map(_process, glob("/proc/[0-9]*"))), reverse=True)
    lines += [f"{cpu_s:8.1f} s  {words}" for cpu_s, words in processes[:MOST_PROCESSES]]
    return "\n".join(lines + _kernel_log()[-KERNEL_LINES:])


def _process(folder: str) -> tuple[float, str] | None:
    """Processor time, and who it is and in what state; None: it has ended meanwhile."""
    fields = _read(f"{folder}/stat").rpartition(")")[2].split()
    if not fields:
        return None
    name = _read(f"{folder}/cmdline").replace("\0", " ") or _read(f"{folder}/comm")
    words = f"{folder.removeprefix('/proc/')} {fields[0]} in {_read(f'{folder}/wchan') or '-'}: {name[:120].strip()}"
    return (int(fields[11]) + int(fields[12])) * TICK_S, words


def _kernel_log() -> list[str]:
    file = os.open("/dev/kmsg", os.O_RDONLY | os.O_NONBLOCK)
    lines = []
    try:
        while True:
            lines.append(os.read(file, 8192).decode(errors="replace").splitlines()[0])
    except BlockingIOError:
        return lines
    finally:
        os.close(file)


def _read(path: str) -> str:
    """A file of /proc; nothing when its process has ended."""
    try:
        return Path(path).read_text().strip()
    except (FileNotFoundError, ProcessLookupError):
        return ""

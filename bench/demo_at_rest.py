"""What a demo of ten parts takes while nobody looks at it: the master and its recorder.

    python -m bench.demo_at_rest [--python PROGRAM]... [--turns 6] [--write]

A real `msbot demo` with the recorder on, of which no page has been opened. Each turn lasts ten seconds. With several
Pythons, one after the other. `--write` puts the table into bench/results/demo_at_rest.md. A minute and a half for each
Python; Linux.
"""

from __future__ import annotations

import argparse
import os
import shutil
import statistics
import sys
import tempfile
import time
from pathlib import Path

from bench.agent import python_of
from bench.class_on_a_pi import usage
from bench.machine import describe_machine
from bench.result import write_result
from bench.running_demo import running_demo
from bench.scale import memory_mb

SETTLED_S = 12.0
TURN_S = 10.0


def measure(python: str, turns: int) -> str:
    """The row of one Python."""
    master, recorder = list[float](), list[float]()
    with tempfile.TemporaryDirectory() as name, running_demo(Path(name), python=python) as (pid, _):
        time.sleep(SETTLED_S)
        for _ in range(turns):
            before, began = usage(pid), time.monotonic()
            time.sleep(TURN_S)
            after, span_s = usage(pid), time.monotonic() - began
            master.append((after.master_s - before.master_s) / span_s)
            recorder.append((after.children_s - before.children_s) / span_s)
        memory = memory_mb(pid)
    return (
        f"| {python_of(python)} | {100 * statistics.median(master):.2f} % "
        f"({100 * min(master):.2f} to {100 * max(master):.2f}) | {100 * statistics.median(recorder):.2f} % "
        f"| {memory:.0f} MB |"
    )


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--python", action="append", default=[], metavar="PROGRAM", help="repeatable")
    options.add_argument("--turns", type=int, default=6, help="turns of ten seconds (default: 6)")
    options.add_argument("--write", action="store_true", help="keep the table in bench/results")
    chosen = options.parse_args()
    lines = [
        f"{describe_machine()}; load {os.getloadavg()[0]:.1f}",
        "",
        "| Python | master, of a core: median (least to most) | its recorder | memory of the master |",
        "|---|---|---|---|",
    ]
    print("\n".join(lines), flush=True)
    for python in chosen.python or [sys.executable]:
        program = os.path.abspath(shutil.which(python) or python)
        lines.append(measure(program, max(1, chosen.turns)))
        print(lines[-1], flush=True)
    if chosen.write:
        write_result(
            "demo_at_rest",
            "A demo of ten parts while nobody looks",
            lines,
            made_by="python -m bench.demo_at_rest --write",
        )


if __name__ == "__main__":
    main()

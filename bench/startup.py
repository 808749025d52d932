"""How long a student waits for `import msbot` and `msbot --help`.

    python bench/startup.py [--runs N] [--write]

Each row is a fresh process with its files in memory: on a busy machine go by the least processor time. `--write` puts
the table into docs/explain/performance.md.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from bench.machine import describe_machine

PAGE = Path(__file__).parent.parent / "docs/explain/performance.md"
BEGIN, END = "<!-- bench/startup.py begins -->", "<!-- bench/startup.py ends -->"
COMMAND = [sys.executable, "-m", "msbot"]


@dataclass(frozen=True)
class Taken:
    """What one start took, in milliseconds."""

    real_ms: float
    processor_ms: float


def process(*arguments: str) -> Taken:
    """A process from its start to its end."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([*arguments], stdout=subprocess.DEVNULL, check=True)
    real_s = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return Taken(real_s * 1e3, (after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime) * 1e3)


ROWS: tuple[tuple[str, str, Callable[[], Taken]], ...] = (
    ("Python itself", "-", lambda: process(sys.executable, "-c", "pass")),
    ("`import msbot`", "40 ms", lambda: process(sys.executable, "-c", "import msbot")),
    ("`msbot --help`", "60 ms", lambda: process(*COMMAND, "--help")),
    ("`msbot parts --help`", "-", lambda: process(*COMMAND, "parts", "--help")),
)


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--runs", type=int, default=7)
    options.add_argument("--write", action="store_true", help=f"put the table into {PAGE.name}")
    chosen = options.parse_args()
    lines = [
        f"{describe_machine()}; {chosen.runs} starts each, files in memory; load {os.getloadavg()[0]:.0f}.",
        "",
        "| start | goal | median ms | least ms | processor, least ms |",
        "|---|---|---|---|---|",
    ]
    for name, goal, start in ROWS:
        start()
        took = [start() for _ in range(chosen.runs)]
        real = [one.real_ms for one in took]
        lines.append(
            f"| {name} | {goal} | {statistics.median(real):,.0f} | {min(real):,.0f} "
            f"| {min(one.processor_ms for one in took):,.0f} |"
        )
    print("\n".join(lines))
    if chosen.write:
        text = PAGE.read_text()
        before, rest = text.split(BEGIN)
        after = rest.split(END)[1]
        PAGE.write_text(f"{before}{BEGIN}\n\n" + "\n".join(lines) + f"\n\n{END}{after}")


if __name__ == "__main__":
    main()

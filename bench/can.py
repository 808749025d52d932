"""What plug-and-play costs on a CAN bus, in virtual time: exact, the same on every machine.

python -m bench.can            # prints all tables
python -m bench.can --write    # and keeps them in bench/results/can.md
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from bench.buses import BUSES, SIZES, Rates, table
from bench.can_costs import THESIS_BYTES, cost_table
from bench.can_load import rest_table, room_table
from bench.can_setup import set_up_table
from bench.can_thesis import AT, one_message, thesis_table
from bench.crowd import Outcome, start_anew, switch_on
from bench.result import write_result
from msbot.process.virtual_time import run_virtual

REST_S = 20.0
"""How long the load at rest is measured."""

Runs = dict[tuple[Rates, int], Outcome]


def say(words: str) -> None:
    """Tell a waiting person how far it is."""
    sys.stderr.write(f"{time.process_time():6.1f} s  {words}\n")


def switch_all_on(folder: Path) -> tuple[Runs, Runs]:
    """Every bus with every number of parts with header compression, and the smallest and largest without."""
    runs: Runs = {}
    plain: Runs = {}
    for rates in BUSES:
        for size in SIZES:
            say(f"{size} parts on {rates.name}")
            runs[rates, size] = run_virtual(switch_on(rates, size, folder, rest_s=REST_S))
            if size in (SIZES[0], SIZES[-1]):
                plain[rates, size] = run_virtual(switch_on(rates, size, folder, compression=False))
    return runs, plain


def crowd_table(runs: Runs) -> list[str]:
    """From power-up to `active`."""
    head = ["bus", "parts", "median", "p95", "max", "all at work", "ratio", "frames", "lost or late"]
    rows = []
    for (rates, size), done in runs.items():
        times = (done.median_s, done.p95_s, done.last_s, done.served_s)
        rows.append(
            [
                rates.name,
                str(size),
                *(f"{1000 * seconds:,.1f}" for seconds in times),
                f"{done.ratio:.2f}",
                f"{sum(done.frames.values()):,}",
                str(done.lost + done.late),
            ]
        )
    return table(head, rows)


def anew_table(folder: Path) -> list[str]:
    """From the start of a new master until all parts are active again."""
    rows = []
    for rates in (BUSES[0], AT, BUSES[4]):
        say(f"a new master under {SIZES[-1]} parts on {rates.name}")
        done = run_virtual(start_anew(rates, SIZES[-1], folder, seed=2))
        times = (f"{1000 * seconds:,.1f}" for seconds in (done.median_s, done.p95_s, done.last_s, done.served_s))
        rows.append([rates.name, *times, f"{done.ratio:.2f}", str(done.lost + done.late)])
    return table(["bus", "median", "p95", "max", "all at work", "ratio", "lost or late"], rows)


def large_table() -> list[str]:
    """The message that took over a minute."""
    rows = []
    for rates in BUSES:
        took_ms, frames = run_virtual(one_message(rates, THESIS_BYTES))
        rows.append([rates.name, f"{took_ms:.2f}", str(frames), f"{60_000 / took_ms:,.0f}"])
    return table(["bus", "ms", "frames", "times quicker than a minute"], rows)


def tables(folder: Path) -> Iterator[tuple[str, list[str]]]:
    """All tables with their names on the page."""
    runs, plain = switch_all_on(folder)
    yield "parts switched on together", crowd_table(runs)
    yield "the same without header compression", crowd_table(plain)
    yield "a new master", anew_table(folder)
    say("messages")
    yield "messages", cost_table()
    yield f"{THESIS_BYTES} bytes", large_table()
    say("set-up")
    yield "set-up", set_up_table()
    say("load")
    yield "load at rest", rest_table(runs, folder)
    yield "room", room_table(folder)
    say("the thesis' figures")
    yield "thesis", thesis_table(runs[AT, SIZES[-1]])


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(description="What plug-and-play costs on a CAN bus, in virtual time.")
    parser.add_argument("--write", action="store_true", help="keep them in bench/results")
    arguments = parser.parse_args()
    kept: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        for name, lines in tables(Path(folder)):
            section = [f"## {name[0].upper()}{name[1:]}", "", *lines, ""]
            print("\n".join(section), flush=True)
            kept += section
    if arguments.write:
        title = "Plug-and-play on a CAN bus, in virtual time"
        write_result("can", title, kept, made_by="python -m bench.can --write")
    say("done")


if __name__ == "__main__":
    main()

"""What the part library and its simulators cost, in CPU time: loading, searching, and a minute of each simulated part.

python -m bench.library [--repeats N]
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from functools import partial
from random import Random

from bench.machine import describe_machine
from msbot.config import PartType, load_library
from msbot.config.library.search import PartSearch
from msbot.sim.part_model import PartModel

QUERIES = ("servo", "ultrasonic range", "joystik", "light sensor i2c")
MINUTE_S = 60.0
TICK_S = 0.05
"""How often a simulated part looks at its world, here."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=9)
    repeats: int = parser.parse_args().repeats
    library = load_library()
    search = PartSearch(library)
    print(f"{describe_machine()}; CPU time, median (least to most) of {repeats}")
    _row(f"read and check {len(library)} part types", _times(load_library, repeats), "ms", 1e3)
    _row("build the index of the search", _times(lambda: PartSearch(library), repeats), "ms", 1e3)
    for query in QUERIES:
        _row(f"search {query!r}", _times(partial(search.find, query), repeats), "us", 1e6)
    shares = {part_type.number: _minute(part_type) / MINUTE_S for part_type in library}
    dearest = max(shares, key=lambda number: shares[number])
    print(
        f"a simulated world takes {100 * statistics.median(shares.values()):.2f} % of a core (median), "
        f"{100 * shares[dearest]:.2f} % at most ({dearest}); "
        f"all {len(shares)} together {100 * sum(shares.values()):.1f} %"
    )


def _times(work: Callable[[], object], repeats: int) -> list[float]:
    times = []
    for _ in range(repeats):
        began = time.process_time()
        work()
        times.append(time.process_time() - began)
    return times


def _minute(part_type: PartType) -> float:
    """CPU seconds of a minute in which the part is looked at twenty times a second."""
    world = PartModel(part_type, Random(1))
    world.start_at(0.0)
    world.join(0.0)
    began = time.process_time()
    for tick in range(int(MINUTE_S / TICK_S)):
        now = tick * TICK_S
        world.advance(now)
        world.due_messages(now)
    return time.process_time() - began


def _row(what: str, times: list[float], unit: str, factor: float) -> None:
    median, least, most = (factor * figure for figure in (statistics.median(times), min(times), max(times)))
    print(f"{what:42} {median:8.1f} {unit} ({least:.1f} to {most:.1f})")


if __name__ == "__main__":
    main()

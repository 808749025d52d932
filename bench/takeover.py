"""How long a robot is without a master when the one that serves it is killed, frozen or cut off.

    python -m bench.takeover [--rounds 30] [--write]

Two masters with `--standby`, a PostgreSQL server and three parts, each on a computer (network namespace) of its own;
needs root, `ip`, and Debian's postgresql. In turn: `kill -9`; SIGSTOP, thawed when the other one serves; the cable to
the database pulled, that to the parts not. A round is right if the other one serves within 5 s, and on the wire no
datagram of the earlier master to a part comes after the first of the later one. `--write` puts the table into
bench/results/takeover.md. Exit status 1 unless all rounds are right.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from pathlib import Path

from bench.machine import describe_machine
from bench.result import write_result
from tests.e2e.two_masters import NotPermitted, Taken, two_masters
from tests.registry.postgres import MISSING, find_server

LIMIT_S = 5.0
FAULTS = {"kill": "`kill -9`", "freeze": "frozen (SIGSTOP), then thawed", "cut": "cut off from the database"}


def measure(rounds: int) -> dict[str, list[Taken]]:
    """What each round took, by fault."""
    programs = find_server()
    if programs is None:
        sys.exit(MISSING)
    taken: dict[str, list[Taken]] = {fault: [] for fault in FAULTS}
    with tempfile.TemporaryDirectory() as folder, two_masters(Path(folder), programs) as robot:
        robot.start()
        for number in range(rounds):
            for fault, found in taken.items():
                one: Taken = getattr(robot, fault)()
                found.append(one)
                print(
                    f"{number + 1:3} {fault:7} serves after {one.serving_s:.2f} s, all parts active after "
                    f"{one.active_s:.2f} s, told by two: {one.stale}",
                    flush=True,
                )
    return taken


def is_right(one: Taken) -> bool:
    """Whether a round was as it should be."""
    return one.serving_s <= LIMIT_S and one.stale == 0


def table(taken: dict[str, list[Taken]]) -> str:
    """The figures as a table."""
    lines = [
        "| the serving master is | right | the other serves: median, longest | all parts active: median, longest | "
        "packets from two masters |",
        "|---|---|---|---|---|",
    ]
    for fault, found in taken.items():
        serving, active = [one.serving_s for one in found], [one.active_s for one in found]
        lines.append(
            f"| {FAULTS[fault]} | {sum(map(is_right, found))} of {len(found)} | {statistics.median(serving):.1f} s, "
            f"{max(serving):.1f} s | {statistics.median(active):.1f} s, {max(active):.1f} s | "
            f"{sum(one.stale for one in found)} |"
        )
    return "\n".join([*lines, "", f"On {describe_machine()}."])


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=30, help="of each kind")
    parser.add_argument("--write", action="store_true", help="keep it in bench/results")
    options = parser.parse_args()
    try:
        taken = measure(options.rounds)
    except NotPermitted as error:
        sys.exit(f"networks of its own need root: {error}")
    words = table(taken)
    print(words)
    if options.write:
        title = "A standby master takes over"
        write_result("takeover", title, words.splitlines(), made_by="python -m bench.takeover --write")
    sys.exit(0 if all(is_right(one) for found in taken.values() for one in found) else 1)


if __name__ == "__main__":
    main()

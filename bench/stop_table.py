"""STOP with all kinds of parts, while all kinds of things happen: who has heard anything after all had confirmed.

    python -m bench.stop_table [--write]

The stories of `tests.stop`, in virtual time: parts in Python, of the firmware (C), in MicroPython's VM and in a browser
speak and listen without a pause; STOP is said; something happens; and when all have confirmed, no function of a part
may get a sample that is still on its way. The rows of real robots are processes in real time: their masters, parts, a
PostgreSQL server and a browser. `--write` puts the table into bench/results/stop_table.md. Needs gcc, node, Chromium
and PostgreSQL. Exit status 1 unless STOP held in every row.
"""

from __future__ import annotations

import argparse
import logging
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from bench.machine import describe_machine
from bench.result import write_result
from tests.firmware.building import pipe_program
from tests.firmware.pipe import Firmware
from tests.homes.chromium import CHROMIUM, BrowserHome, Chromium
from tests.homes.test_conformance import HOMES
from tests.homes.world import Home
from tests.registry.postgres import MISSING, find_server
from tests.stop.cuts import AGENT, LINKS, RELAY, cut_stories, deeds_for
from tests.stop.gap import gap_stories
from tests.stop.kinds import CHome, stories
from tests.stop.leases import lease_stories
from tests.stop.oracle import Verdict
from tests.stop.real_class import class_stories
from tests.stop.ways import CUTS, agents_story, takeover_story
from tests.stop.work import DEEDS, SAYERS, work_story

TITLE = "STOP: nothing is heard after all have confirmed"
HEAD = ["| parts | meanwhile | all confirmed after, ms | samples on the way | heard | |", "|---|---|---|---|---|---|"]
NAMES = {
    "cpython": "Python",
    "c": "C (firmware)",
    "micropython-can": "MicroPython, CAN",
    "micropython-serial": "MicroPython, serial",
    "browser": "in the browser",
}


Told = Iterator[tuple[str, str, Verdict]]
"""Parts, what happened meanwhile, and what came of it."""


def tell(firmware: Firmware, chromium: Chromium) -> Told:
    """All stories."""

    def home(kind: str) -> Home:
        if kind == "c":
            return CHome(firmware)
        return BrowserHome(chromium) if kind == "browser" else HOMES[kind]()

    for kind, name in NAMES.items():
        for words, verdict in stories(home(kind)).items():
            yield name, words, verdict
        for words, verdict in gap_stories(home(kind), has_bus=kind not in LINKS).items():
            yield name, words, verdict
        for way, near in ((AGENT, False), (AGENT, True), (RELAY, False), (RELAY, True)):
            if near and kind in LINKS:
                continue
            place = f"{name}; behind {way}, its partner {'beside it' if near else 'at the master'}"
            deeds = deeds_for(kind, also_long=True)
            for words, verdict in cut_stories(home(kind), kind, way, deeds, near=near).items():
                yield place, words, verdict
    with tempfile.TemporaryDirectory() as folder:
        verdict = takeover_story(Path(folder), firmware)
        yield "Python, C", "the master is killed, another one takes over", verdict
    for cut in CUTS:
        yield "Python, at two agents", cut, agents_story(cut)
    for deed in (*DEEDS, *SAYERS):
        with tempfile.TemporaryDirectory() as folder:
            yield "simulated rover", deed, work_story(Path(folder), deed)
    with tempfile.TemporaryDirectory() as folder:
        for words, verdict in class_stories(Path(folder), CHROMIUM).items():
            yield "two real robots", words, verdict
    programs = find_server()
    if programs is None:
        sys.exit(MISSING)
    with tempfile.TemporaryDirectory() as folder:
        for words, verdict in lease_stories(Path(folder), programs).items():
            yield "a real robot, two masters", words, verdict


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args()
    logging.disable(logging.CRITICAL)
    lines = [
        describe_machine() + "; times are exact, in virtual time; real robots in real time, without them",
        "",
        *HEAD,
    ]
    print("\n".join(lines), flush=True)
    firmware, chromium = Firmware(pipe_program()), Chromium()
    all_held = True
    try:
        for parts, words, verdict in tell(firmware, chromium):
            all_held = all_held and verdict.is_right
            took = "" if verdict.confirmed_ms is None else f"{verdict.confirmed_ms:.1f}"
            lines.append(
                f"| {parts} | {words} | {took} | {verdict.on_the_way} "
                f"| {sum(verdict.after.values())} | {'held' if verdict.is_right else 'DID NOT HOLD'} |"
            )
            print(lines[-1], flush=True)
    finally:
        firmware.close()
        chromium.close()
    if options.write:
        write_result("stop_table", TITLE, lines, made_by="python -m bench.stop_table --write")
    sys.exit(0 if all_held else 1)


if __name__ == "__main__":
    main()

"""Hours of abuse of a robot in real processes, with an oracle that says what must hold all the time.

    python -m bench.soak --minutes 30 --seed 1 [--keep FILE.json] [--bus can:vcan0] [--calm-master]
    python -m bench.soak --table FILE.json... [--write]

A master with its page and an SQLite database, parts over UDP, TCP, WebSocket and a simulated CAN bus, intruders on each
of them. Chance (`--seed`) kills, freezes, cuts and restarts them, locks, deletes and replaces the database, and does
what people do. `bench/soaking/oracle.py`, `states.py`, `journal.py` and `flatness.py` say what is a violation; each is
printed with seed, time and the last acts. Exit status 1 when there was one. `--calm-master` leaves the master alone, so
that its memory can be seen over the whole time. `--table` prints what several runs have kept; `--write` puts that into
bench/results/soak.md. Linux; where other
masters run, in a network of its own (`unshare -n`, `ip link set lo up`): a STOP for all of a computer reaches it, too.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import os
import signal
import statistics
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from bench.machine import describe_machine
from bench.result import write_result
from bench.soaking.acts import Acts
from bench.soaking.flatness import growth
from bench.soaking.scene import Scene

MASTER_ACTS = frozenset({"kill the master (kill -9)", "end the master", "replace the database"})
MOST_AT_ONCE = 4
CALM_S = 45.0
"""In the end everything must be well within this time."""
AUTHENTICATIONS = ("key", "key+data", "open")


async def soak(options: argparse.Namespace, folder: Path) -> dict[str, object]:
    """One run; gives its figures. SIGTERM ends it before its time, in good order."""
    enough = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, enough.set)
    bus = options.bus or f"sim:soak{os.getpid()}"
    kinds = ["udp", "tcp", bus, "udp", "ws", bus, "tcp", bus][: options.parts]
    authentication = AUTHENTICATIONS[options.seed % len(AUTHENTICATIONS)]
    without = MASTER_ACTS if options.calm_master else frozenset()
    scene = Scene(folder, kinds, authentication, options.seed, lambda words: print(words, flush=True))
    print(
        f"seed {options.seed}, {options.minutes:g} minutes, {len(kinds)} parts on {', '.join(kinds)}; "
        f"authentication {authentication}; {describe_machine()}; everything in {folder}",
        flush=True,
    )
    acts = Acts(scene)
    watching: asyncio.Task[None] | None = None
    try:
        await scene.begin()
        began = time.monotonic()
        watching = asyncio.create_task(scene.watch())
        said = began
        while time.monotonic() - began < 60 * options.minutes and not watching.done() and not enough.is_set():
            await asyncio.sleep(scene.dice.expovariate(1 / options.pace))
            if acts.running < MOST_AT_ONCE:
                acts.start(without)
            if time.monotonic() - said > 60.0:
                said = time.monotonic()
                print(line(scene), flush=True)
        await acts.finish()
        await settle(scene)
        await scene.read_journal()
    finally:
        try:
            if watching is not None:
                watching.cancel()
                await asyncio.gather(watching, return_exceptions=True)
                if not watching.cancelled() and (error := watching.exception()) is not None:
                    scene.complain(time.monotonic(), "script", f"it looks no more: {error!r}")
        finally:
            await scene.robot.close()
    scene.judge_all()
    for found in scene.growth:
        if (grown := growth(found)) is not None:
            for trouble in grown.troubles:
                scene.complain(time.monotonic(), "growth", trouble)
    scene.tell_violations()
    return figures(scene, options, authentication, time.monotonic() - began)


async def settle(scene: Scene) -> None:
    """When nothing is done any more, everything is well."""
    end = time.monotonic() + CALM_S
    while time.monotonic() < end:
        await asyncio.sleep(1.0)
        if scene.is_well():
            await asyncio.sleep(12.0)  # so long the oracle may take to miss a sample
            return
    missing = [slot for slot, part in scene.states.parts.items() if part.joined is None]
    scene.complain(time.monotonic(), "end", f"{CALM_S:g} s after the last act not active: {missing}")


def line(scene: Scene) -> str:
    """How it goes."""
    last = scene.growth[-1][-1] if scene.growth and scene.growth[-1] else None
    need = f"master {last.rss_mb:.0f} MB, {last.tasks} tasks, {last.files} files" if last else "master not measured yet"
    return (
        f"{scene.clock() / 60:6.1f} min: {scene.acts.total()} acts, {scene.samples.accepted} samples sent, "
        f"{scene.samples.heard} heard, {sum(scene.tried.values())} tries of intruders, {scene.journal.lines} lines "
        f"of the journal, {need}, {len(scene.violations)} violations; load {os.getloadavg()[0]:.1f}"
    )


def figures(scene: Scene, options: argparse.Namespace, authentication: str, seconds: float) -> dict[str, object]:
    """What is kept of a run."""
    grown = max((one for one in map(growth, scene.growth) if one), key=lambda one: one.seconds, default=None)
    return {
        "seed": options.seed,
        "minutes": seconds / 60,
        "authentication": authentication,
        "links": scene.robot.kinds,
        "machine": describe_machine(),
        "load": os.getloadavg()[2],
        "stalls_s": scene.stalls,
        "acts": dict(scene.acts),
        "sent": scene.samples.accepted,
        "heard": scene.samples.heard,
        "left_out": scene.samples.left_out,
        "tried": sum(scene.tried.values()),
        "pages": scene.pages,
        "journal": scene.journal.lines,
        "edits": len(scene.acknowledged),
        "violations": dict(Counter(one.rule for one in scene.violations)),
        "back": dict(scene.back),
        "growth": None
        if grown is None
        else {
            "minutes": grown.seconds / 60,
            "first_mb": grown.first_mb,
            "last_mb": grown.last_mb,
            "mb_per_hour": grown.mb_per_hour,
            "tasks": grown.tasks,
            "threads": grown.threads,
            "files": grown.files,
        },
    }


def table(runs: list[dict[str, object]]) -> str:
    """All runs, for people."""
    lines = [
        "| seed | minutes | authentication | acts | samples sent, heard, left out and told | tries of intruders | "
        "answers of the page | lines of the journal | memory after the warm-up | violations |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    acts: Counter[str] = Counter()
    back: dict[str, list[float]] = {}
    for run in runs:
        acts.update(_counts(run["acts"]))
        found = run["back"]
        assert isinstance(found, dict)
        for what, times in found.items():
            back.setdefault(what, []).extend(times)
        violations = _counts(run["violations"])
        told = ", ".join(f"{count} {rule}" for rule, count in violations.items()) or "none"
        lines.append(
            f"| {run['seed']} | {float(str(run['minutes'])):.0f} | {run['authentication']} | "
            f"{_counts(run['acts']).total()} | {run['sent']}, {run['heard']}, {run['left_out']} | {run['tried']} | "
            f"{run['pages']} | {run['journal']} | {_memory(run['growth'])} | {told} |"
        )
    minutes = sum(float(str(run["minutes"])) for run in runs)
    done = ", ".join(f"{name} {count}" for name, count in acts.most_common())
    lines += ["", f"In all {minutes / 60:.1f} hours. What was done, and how often: {done}.", ""]
    lines += ["| what was wrong | times | active again after its end: median, 95 %, longest |", "|---|---|---|"]
    for what, times in sorted(back.items(), key=lambda one: -len(one[1])):
        ordered = sorted(times)
        lines.append(
            f"| {what} | {len(times)} | {statistics.median(ordered):.1f} s, "
            f"{ordered[math.ceil(0.95 * len(ordered)) - 1]:.1f} s, {ordered[-1]:.1f} s |"
        )
    return "\n".join(lines)


def _counts(found: object) -> Counter[str]:
    assert isinstance(found, dict)
    return Counter({str(name): int(count) for name, count in found.items()})


def _memory(found: object) -> str:
    if not isinstance(found, dict):
        return "no master ran for long enough"
    return (
        f"{found['first_mb']:.0f} to {found['last_mb']:.0f} MB in {found['minutes']:.0f} min "
        f"({found['mb_per_hour']:+.1f} MB an hour); {found['tasks'][0]}, then {found['tasks'][1]} tasks"
    )


def main() -> None:
    """Run, or tell of runs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--hours", type=float, help="instead of --minutes")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--parts", type=int, default=8, help="2 to 8")
    parser.add_argument("--pace", type=float, default=2.0, help="seconds between two acts, on average")
    parser.add_argument("--bus", help="a bus instead of a simulated one, for example can:vcan0")
    parser.add_argument("--calm-master", action="store_true", help="do not end the master")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="keep the figures of this run as JSON")
    parser.add_argument("--folder", type=Path, help="keep everything there, logs and database; must not exist")
    parser.add_argument("--table", type=Path, nargs="+", metavar="FILE", help="run nothing, print what was kept")
    parser.add_argument("--write", action="store_true", help="with --table: keep it in bench/results")
    options = parser.parse_args()
    if options.table:
        words = table([json.loads(file.read_text()) for file in options.table])
        print(words)
        if options.write:
            command = "python -m bench.soak --table FILE ... --write"
            write_result("soak", "Hours of trouble at random", words.splitlines(), made_by=command)
        return
    if options.hours:
        options.minutes = 60 * options.hours
    with tempfile.TemporaryDirectory() as name:
        folder = options.folder or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        run = asyncio.run(soak(options, folder))
    print(table([run]))
    if options.keep:
        options.keep.write_text(json.dumps(run))
    sys.exit(1 if run["violations"] else 0)


if __name__ == "__main__":
    main()

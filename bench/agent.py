"""The agent under load over UDP on this machine: the loads of a C generator, beside the genuine agent's figures.

    python bench/agent.py [--quick] [--write] [--against CHECKOUT [--pairs N] [--load NAME]]

Needs gcc for the generator (`xrce_load.c`). Agent and generator get a core each. `--write` keeps the table in
bench/results/agent.md. `--against` runs the agent of another checkout and this one in turn, a second each, and
prints both: what a computer can do changes from day to day, what one version does beside another does not. With
`--load` and `--write` the rows of these loads replace those in bench/results/agent_versions.md.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import shutil
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.machine import describe_machine
from bench.result import FOLDER, write_result

SOURCE = Path(__file__).with_name("xrce_load.c")
PING = bytes.fromhex("80000000 02010800 000afffd 02000000")
CPU_KEY = "agent_cpu_us_per_msg"


@dataclass(frozen=True)
class Load:
    """One load and what the genuine agent (C++ 2.4.2, in-memory middleware) did with it on a like machine."""

    name: str
    arguments: str
    rate_key: str
    latency_key: str
    peer_rate: float | None
    peer_cpu_us: float | None


LOADS = (
    Load("best effort 1 -> 1, in flight 1", "pubsub_be --inflight 1", "msgs_per_s", "lat", 12_955, 44),
    Load("best effort 1 -> 1, in flight 8", "pubsub_be --inflight 8", "msgs_per_s", "lat", 83_132, 11.8),
    Load("best effort 1 -> 4, in flight 8", "pubsub_be --subs 4 --inflight 8", "msgs_per_s", "lat", 129_004, 7.7),
    Load("best effort, 20,000/s", "pubsub_be --rate 20000", "msgs_per_s", "lat", 19_932, 32),
    Load("reliable, in flight 1", "pubsub_rel --inflight 1", "msgs_per_s", "lat", 11_890, 53),
    Load("reliable, in flight 16", "pubsub_rel --inflight 16", "msgs_per_s", "lat", 64_272, 15),
    Load(
        "reliable 4 -> 4, in flight 4", "pubsub_rel --pubs 4 --subs 4 --inflight 4", "msgs_per_s", "lat", 104_867, 9.5
    ),
    Load("reliable, 1 % loss", "loss --loss 1", "msgs_per_s", "lat", 33_195, 19),
    Load("reliable, 5 % loss", "loss --loss 5", "msgs_per_s", "lat", 2_624, 21),
    Load("reliable, 20 % loss", "loss --loss 20", "msgs_per_s", "lat", 190, 43),
    Load("request/reply over topics, 1 open", "reqrep --rr topics --inflight 1", "roundtrips_per_s", "rtt", 6_035, 107),
    Load(
        "request/reply over topics, 16 open", "reqrep --rr topics --inflight 16", "roundtrips_per_s", "rtt", 28_414, 35
    ),
    Load("request/reply native, 16 open", "reqrep --inflight 16", "roundtrips_per_s", "rtt", None, None),
    Load("sessions up and down, 1 at a time", "sessions --clients 1", "sessions_per_s", "up", 3_797, 200),
    Load("sessions up and down, 16 at a time", "sessions --clients 16", "sessions_per_s", "up", 13_031, 83),
    Load(
        "1000 clients, 1 request/s each", "idle_heartbeat --clients 1000 --rate 1", "roundtrips_per_s", "rtt", None, 284
    ),
)
PROBLEMS = ("lost", "missing", "duplicates", "dup_or_late", "out_of_order", "failed")


def main() -> None:
    """Run all loads and print one table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--quick", action="store_true", help="one run of 1 s instead of three of 3 s")
    options.add_argument("--write", action="store_true", help="keep it in bench/results")
    options.add_argument("--against", type=Path, metavar="CHECKOUT", help="compare with the version in this folder")
    options.add_argument("--pairs", type=int, default=5, help="with --against: how often both run (default: 5)")
    options.add_argument("--load", action="append", default=[], help="with --against: only this one; may be repeated")
    chosen = options.parse_args()
    generator = build_generator()
    if chosen.against:
        if not sources_of(chosen.against):
            sys.exit(f"{chosen.against} is no checkout of MsBOT: it has neither packages/*/src nor src")
        lines = compare(generator, chosen.against, max(1, chosen.pairs), chosen.load)
        if chosen.load and chosen.write:
            lines = [*with_new_rows(FOLDER / "agent_versions.md", lines)]
        name, title, command = "agent_versions", "Two versions of the agent in turn", "--against CHECKOUT --write"
    else:
        lines = measure(generator, *((1, 1) if chosen.quick else (3, 3)))
        name, title, command = "agent", "The agent under load over UDP", "--write"
    if chosen.write:
        write_result(name, title, lines, made_by=f"python bench/agent.py {command}")


def measure(generator: Path, runs: int, seconds: int) -> list[str]:
    """All loads beside the genuine agent's figures: the lines of the table, printed as they come."""
    lines = [
        f"{describe_machine()}; agent on one core, generator on the other; median of {runs} run(s) of {seconds} s, "
        "64-byte payload. Spread: (largest - smallest) / median. The genuine agent's figures (C++, Release, "
        "in-memory middleware) were taken earlier on a like machine with the same generator.",
        "",
        "| load | per second | spread | p50 / p99 µs | agent CPU µs | wrong | genuine per second | CPU µs | ratio |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    print("\n".join(lines), flush=True)
    for load in LOADS:
        line = row(load, [run(generator, load, seconds) for _ in range(runs)])
        print(line, flush=True)
        lines.append(line)
    return lines


def compare(generator: Path, other: Path, pairs: int, only: Sequence[str] = ()) -> list[str]:
    """All loads with the agent of another checkout and with this one in turn: the lines of the table."""
    version = subprocess.run(
        ["git", "-C", str(other), "log", "-1", "--format=%cs, %h"], capture_output=True, text=True, check=False
    ).stdout.strip()
    lines = [
        f"{describe_machine()}; agent on one core, generator on the other; the version before ({version or other.name})"
        " and this one in turn, pairs of 1 s each; medians, and the median of the pairs' ratios.",
        "",
        "| load | pairs | per second before | after | ratio | p50 µs before | after "
        "| agent CPU µs before | after | ratio | wrong |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    print("\n".join(lines), flush=True)
    for load in (one for one in LOADS if not only or one.name in only):
        before: list[Result] = []
        after: list[Result] = []
        for number in range(pairs):
            # Each goes first in every other pair: a computer that was idle is faster in the run that follows.
            turns = [(before, other), (after, None)]
            for results, checkout in turns if number % 2 == 0 else reversed(turns):
                results.append(run(generator, load, 1, checkout=checkout))
        line = pair_row(load, before, after)
        print(line, flush=True)
        lines.append(line)
    return lines


def with_new_rows(path: Path, lines: Sequence[str]) -> Iterator[str]:
    """The table that is kept there, with those of its rows that were measured again."""
    new = {line.split("|")[1]: line for line in lines if line.startswith("| ")}
    for line in path.read_text("utf-8").splitlines()[4:]:
        yield new.get(line.split("|")[1], line) if line.startswith("| ") else line


def build_generator() -> Path:
    """Compile the generator once for each version of its source."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        sys.exit("bench/agent.py needs a C compiler for the load generator: install gcc")
    name = f"msbot-xrce-load-{hashlib.sha256(SOURCE.read_bytes()).hexdigest()[:12]}"
    program = Path(tempfile.gettempdir()) / name
    if not program.exists():
        subprocess.run([compiler, "-std=c11", "-O2", "-o", str(program), str(SOURCE)], check=True)
    return program


Result = dict[str, float]


def run(generator: Path, load: Load, seconds: int, *options: str, checkout: Path | None = None) -> Result:
    """One run against a fresh agent, which is started with these options besides."""
    with agent(*options, checkout=checkout) as (port, pid):
        arguments = [*load.arguments.split(), "--agent", f"127.0.0.1:{port}", "--agent-pid", str(pid)]
        done = subprocess.run(
            [*pinned(1), str(generator), *arguments, "--duration", str(seconds)],
            capture_output=True,
            text=True,
            check=False,
        )
    try:
        result: Result = json.loads(done.stdout)
    except ValueError:
        sys.exit(f"{load.name}: the generator said: {done.stderr or done.stdout}")
    return result


@contextlib.contextmanager
def agent(*options: str, checkout: Path | None = None) -> Iterator[tuple[int, int]]:
    """`msbot agent udp4` on a free port and a core of its own: (port, process)."""
    port = free_port()
    process = start_agent(port, *options, checkout=checkout)
    try:
        wait_for(port)
        yield port, process.pid
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait()


def free_port() -> int:
    """A port that nobody uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def start_agent(port: int, *options: str, checkout: Path | None = None) -> subprocess.Popen[bytes]:
    """`msbot agent udp4`, of this version or of that in another checkout, on a core of its own; the caller ends it."""
    return subprocess.Popen(
        [*pinned(0), sys.executable, "-m", "msbot", "agent", "udp4", "-p", str(port), "-v", "1", *options],
        stdout=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": ":".join(sources_of((checkout or SOURCE.parent.parent).resolve()))},
    )


def sources_of(checkout: Path) -> list[str]:
    """The folders of a checkout that belong into PYTHONPATH."""
    return [str(path) for path in (*sorted(checkout.glob("packages/*/src")), checkout / "src") if path.is_dir()]


def wait_for(port: int) -> None:
    """Ping the agent (GET_INFO) until it answers."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.settimeout(0.1)
        for _ in range(100):
            client.sendto(PING, ("127.0.0.1", port))
            try:
                client.recv(1024)
            except (TimeoutError, ConnectionError):
                continue
            return
    sys.exit("the agent does not answer")


def pinned(core: int) -> list[str]:
    """What runs the rest of a command on one core; nothing where that cannot be done."""
    taskset = shutil.which("taskset")
    return [taskset, "-c", str(core)] if taskset and (os.cpu_count() or 1) > 1 else []


def row(load: Load, results: list[Result]) -> str:
    """A line of the table."""
    rates = [result[load.rate_key] for result in results]
    rate = statistics.median(rates)
    spread = (max(rates) - min(rates)) / rate if rate else 0.0
    p50, p99 = (
        statistics.median(result[f"{load.latency_key}_{name}_us"] for result in results) for name in ("p50", "p99")
    )
    cpu = statistics.median(result.get(CPU_KEY, 0.0) for result in results)
    said = problems(results)
    peer = "-" if load.peer_rate is None else f"{load.peer_rate:,.0f}"
    peer_cpu = "-" if load.peer_cpu_us is None else f"{load.peer_cpu_us:g}"
    ratio = "-" if load.peer_rate is None else f"{rate / load.peer_rate:.2f}"
    return (
        f"| {load.name} | {rate:,.0f} | {spread:.0%} | {p50:.0f} / {p99:.0f} | {cpu:.1f} | {said} "
        f"| {peer} | {peer_cpu} | {ratio} |"
    )


def pair_row(load: Load, before: list[Result], after: list[Result]) -> str:
    """A line of the comparison."""

    def medians(key: str) -> tuple[float, float, float]:
        """Of a figure: before, after, and of the ratios of the pairs."""
        pairs = [(old.get(key, 0.0), new.get(key, 0.0)) for old, new in zip(before, after, strict=True)]
        ratios = [new / old for old, new in pairs if old] or [float("nan")]
        return (
            statistics.median(old for old, _ in pairs),
            statistics.median(new for _, new in pairs),
            statistics.median(ratios),
        )

    rate, rate_now, rate_ratio = medians(load.rate_key)
    p50, p50_now, _ = medians(f"{load.latency_key}_p50_us")
    cpu, cpu_now, cpu_ratio = medians(CPU_KEY)
    return (
        f"| {load.name} | {len(before)} | {rate:,.0f} | {rate_now:,.0f} | {rate_ratio:.2f} | {p50:.0f} | {p50_now:.0f} "
        f"| {cpu:.1f} | {cpu_now:.1f} | {cpu_ratio:.2f} | before: {problems(before)}; after: {problems(after)} |"
    )


def problems(results: list[Result]) -> str:
    """What went wrong in these runs, in words."""
    wrong = {name: int(sum(result.get(name, 0) for result in results)) for name in PROBLEMS}
    return ", ".join(f"{count} {name}" for name, count in wrong.items() if count) or "nothing"


if __name__ == "__main__":
    main()

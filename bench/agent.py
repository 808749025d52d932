"""The agent under load over UDP on this machine: the loads of a C generator, alone or beside another agent.

    python -m bench.agent [--quick] [--pairs N] [--load NAME] [--write]
        [--genuine PROGRAM [--python PROGRAM]... | --against CHECKOUT]

Needs gcc for the generator (`xrce_load.c`). Agent and generator get a core each.

Two agents run in turn, a second each: what a computer can do changes from minute to minute, what one agent does beside
another does not. `--genuine` runs eProsima's `MicroXRCEAgent` (built elsewhere, with its middleware in memory) and
this agent, once with each `--python`; `--against` the agent of another checkout and this one.

`--write` keeps the table in bench/results: `agent.md` beside the genuine agent, `agent_versions.md` with `--against`.
With `--load`, the rows of these loads replace those in the latter.
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
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.machine import describe_machine
from bench.result import FOLDER, write_result
from msbot_agent.process.user_folders import cache_folder, make_own_folder

SOURCE = Path(__file__).with_name("xrce_load.c")
PING = bytes.fromhex("80000000 02010800 000afffd 02000000")
CPU_KEY = "agent_cpu_us_per_msg"


@dataclass(frozen=True)
class Load:
    """One load, and the names of its rate and its latency in the generator's answer."""

    name: str
    arguments: str
    rate_key: str
    latency_key: str


LOADS = (
    Load("best effort 1 -> 1, in flight 1", "pubsub_be --inflight 1", "msgs_per_s", "lat"),
    Load("best effort 1 -> 1, in flight 8", "pubsub_be --inflight 8", "msgs_per_s", "lat"),
    Load("best effort 1 -> 4, in flight 8", "pubsub_be --subs 4 --inflight 8", "msgs_per_s", "lat"),
    Load("best effort, 20,000/s", "pubsub_be --rate 20000", "msgs_per_s", "lat"),
    Load("reliable, in flight 1", "pubsub_rel --inflight 1", "msgs_per_s", "lat"),
    Load("reliable, in flight 16", "pubsub_rel --inflight 16", "msgs_per_s", "lat"),
    Load("reliable 4 -> 4, in flight 4", "pubsub_rel --pubs 4 --subs 4 --inflight 4", "msgs_per_s", "lat"),
    Load("reliable, 1 % loss", "loss --loss 1", "msgs_per_s", "lat"),
    Load("reliable, 5 % loss", "loss --loss 5", "msgs_per_s", "lat"),
    Load("reliable, 20 % loss", "loss --loss 20", "msgs_per_s", "lat"),
    Load("request/reply over topics, 1 open", "reqrep --rr topics --inflight 1", "roundtrips_per_s", "rtt"),
    Load("request/reply over topics, 16 open", "reqrep --rr topics --inflight 16", "roundtrips_per_s", "rtt"),
    Load("request/reply native, 1 open", "reqrep --inflight 1", "roundtrips_per_s", "rtt"),
    Load("request/reply native, 16 open", "reqrep --inflight 16", "roundtrips_per_s", "rtt"),
    Load("sessions up and down, 1 at a time", "sessions --clients 1", "sessions_per_s", "up"),
    Load("sessions up and down, 16 at a time", "sessions --clients 16", "sessions_per_s", "up"),
    Load("1000 clients, 1 request/s each", "idle_heartbeat --clients 1000 --rate 1", "roundtrips_per_s", "rtt"),
    Load(
        "1000 clients, 1 request/s each, over topics",
        "idle_heartbeat --clients 1000 --rate 1 --rr topics",
        "roundtrips_per_s",
        "rtt",
    ),
)
PROBLEMS = ("lost", "missing", "duplicates", "dup_or_late", "out_of_order", "failed", "refused")


@dataclass(frozen=True)
class Contender:
    """An agent that can be started: its command, with {port} in it, and where its Python modules are."""

    command: tuple[str, ...]
    path: str = ""

    def start(self, port: int) -> subprocess.Popen[bytes]:
        """Start it on a core of its own; the caller ends it."""
        return subprocess.Popen(
            [*pinned(0), *(word.format(port=port) for word in self.command)],
            stdin=subprocess.PIPE,  # the genuine agent ends with its input
            stdout=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": self.path} if self.path else None,
        )


def ours(*options: str, checkout: Path | None = None, python: str = sys.executable) -> Contender:
    """`msbot agent udp4`, of this version or of that in another checkout."""
    return Contender(
        (python, "-m", "msbot", "agent", "udp4", "-p", "{port}", "-v", "1", *options),
        ":".join(sources_of((checkout or SOURCE.parent.parent).resolve())),
    )


def genuine(program: str) -> Contender:
    """eProsima's agent with its middleware in memory."""
    return Contender((program, "udp4", "-p", "{port}", "-m", "ced"))


def main() -> None:
    """Run the loads and print one table."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--quick", action="store_true", help="one run of 1 s, or one pair")
    options.add_argument("--write", action="store_true", help="keep it in bench/results")
    options.add_argument("--genuine", metavar="PROGRAM", help="compare with this MicroXRCEAgent")
    options.add_argument(
        "--python", action="append", default=[], metavar="PROGRAM", help="with --genuine: a Python for ours; repeatable"
    )
    options.add_argument("--against", type=Path, metavar="CHECKOUT", help="compare with the version in this folder")
    options.add_argument("--pairs", type=int, default=5, help="how often both run (default: 5)")
    options.add_argument("--load", action="append", default=[], help="only this one; may be repeated")
    chosen = options.parse_args()
    loads = [one for one in LOADS if not chosen.load or one.name in chosen.load]
    if unknown := set(chosen.load) - {one.name for one in LOADS}:
        sys.exit(f"no load {', '.join(sorted(unknown))}; there are: {'; '.join(one.name for one in LOADS)}")
    generator = build_generator()
    pairs = 1 if chosen.quick else max(1, chosen.pairs)
    if chosen.genuine:
        lines = []
        for python in chosen.python or [sys.executable]:
            which = f"eProsima's agent (C++, middleware in memory) and `msbot agent` with {python_of(python)}"
            lines += [*compare(generator, loads, (genuine(chosen.genuine), ours(python=python)), pairs, which), ""]
        name, title, command = "agent", "The agent beside eProsima's, over UDP", "--genuine PROGRAM --write"
    elif chosen.against:
        if not sources_of(chosen.against):
            sys.exit(f"{chosen.against} is no checkout of MsBOT: it has neither packages/*/src nor src")
        first, second = ours(checkout=chosen.against), ours()
        lines = compare(
            generator, loads, (first, second), pairs, f"the version before ({version_of(chosen.against)}) and this one"
        )
        name, title, command = "agent_versions", "Two versions of the agent in turn", "--against CHECKOUT --write"
    else:
        lines = measure(generator, loads, *((1, 1) if chosen.quick else (3, 3)))
        name, title, command = "agent_alone", "The agent under load over UDP", "--write"
    if chosen.write:
        if chosen.load and chosen.against:
            lines = [*with_new_rows(FOLDER / f"{name}.md", lines)]
        write_result(name, title, lines, made_by=f"python -m bench.agent {command}")


def measure(generator: Path, loads: Sequence[Load], runs: int, seconds: int) -> list[str]:
    """The loads, one after the other: the lines of the table, printed as they come."""
    lines = [
        f"{describe_machine()}; agent on one core, generator on the other; median of {runs} run(s) of {seconds} s, "
        "64-byte payload. Spread: (largest - smallest) / median.",
        "",
        "| load | per second | spread | p50 / p99 µs | agent CPU µs | wrong |",
        "|---|---|---|---|---|---|",
    ]
    print("\n".join(lines), flush=True)
    for load in loads:
        line = row(load, [run(generator, load, seconds) for _ in range(runs)])
        print(line, flush=True)
        lines.append(line)
    return lines


def compare(
    generator: Path, loads: Sequence[Load], two: tuple[Contender, Contender], pairs: int, which: str
) -> list[str]:
    """The loads with two agents in turn: the lines of the table, printed as they come."""
    lines = [
        f"{describe_machine()}, load {os.getloadavg()[0]:.1f} before it began; agent on one core, generator on the "
        f"other, 64-byte payload; {which} in turn, pairs of 1 s each; medians, and the median of the pairs' ratios "
        "(second : first). Where other programs took much of the time, only the processor time compares.",
        "",
        "| load | pairs | per second, first | second | ratio | p50 µs, first | second | ratio "
        "| agent CPU µs, first | second | ratio | wrong |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    print("\n".join(lines), flush=True)
    for load in loads:
        results: tuple[list[Result], list[Result]] = ([], [])
        for number in range(pairs):
            # Each goes first in every other pair: a computer that was idle is faster in the run that follows.
            for which_one in (0, 1) if number % 2 == 0 else (1, 0):
                results[which_one].append(run(generator, load, 1, contender=two[which_one]))
        line = pair_row(load, *results)
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
    program = cache_folder() / name  # it is run: nobody else can put one there
    make_own_folder(program.parent)
    if not program.exists():
        subprocess.run([compiler, "-std=c11", "-O2", "-o", str(program), str(SOURCE)], check=True)
    return program


Result = dict[str, float]


def run(generator: Path, load: Load, seconds: int, *options: str, contender: Contender | None = None) -> Result:
    """One run against a fresh agent: that one, or ours, which is started with these options besides."""
    with serving(contender or ours(*options)) as (port, pid):
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
        words = f"{load.name}: the generator said: {done.stderr or done.stdout}".strip()
        if contender is None:
            sys.exit(words)
        result = {}
    if load.rate_key not in result:
        print(f"{load.name}: {(done.stderr or done.stdout).strip()}", file=sys.stderr)
        return {"refused": 1}
    return result


@contextlib.contextmanager
def agent(*options: str) -> Iterator[tuple[int, int]]:
    """`msbot agent udp4` on a free port and a core of its own: (port, process)."""
    with serving(ours(*options)) as found:
        yield found


@contextlib.contextmanager
def serving(contender: Contender) -> Iterator[tuple[int, int]]:
    """That agent on a free port and a core of its own: (port, process)."""
    port = free_port()
    process = contender.start(port)
    try:
        wait_for(port)
        yield port, process.pid
    finally:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(5)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def free_port() -> int:
    """A port that nobody uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def start_agent(port: int, *options: str) -> subprocess.Popen[bytes]:
    """`msbot agent udp4` of this version on a core of its own; the caller ends it."""
    return ours(*options).start(port)


def version_of(checkout: Path) -> str:
    """The date and the name of what is checked out there."""
    said = subprocess.run(
        ["git", "-C", str(checkout), "log", "-1", "--format=%cs, %h"], capture_output=True, text=True, check=False
    )
    return said.stdout.strip() or checkout.name


def python_of(program: str) -> str:
    """Which Python that program is: two of one version differ by how they were built."""
    code = "import sys; print('CPython', ' '.join(sys.version.split()))"
    return subprocess.run([program, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


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
    said = problems(results) or "nothing"
    return f"| {load.name} | {rate:,.0f} | {spread:.0%} | {p50:.0f} / {p99:.0f} | {cpu:.1f} | {said} |"


def pair_row(load: Load, first: list[Result], second: list[Result]) -> str:
    """A line of the comparison."""

    def medians(key: str, form: str) -> str:
        """Of a figure: of the first, of the second, and of the ratios of the pairs."""
        pairs = [
            (one[key], other[key]) for one, other in zip(first, second, strict=True) if key in one and key in other
        ]
        ratios = [other / one for one, other in pairs if one]
        cells = [[one[key] for one in results if key in one] for results in (first, second)]
        words = [format(statistics.median(cell), form) if cell else "-" for cell in cells]
        return " | ".join([*words, f"{statistics.median(ratios):.2f}" if ratios else "-"])

    rate, p50 = medians(load.rate_key, ",.0f"), medians(f"{load.latency_key}_p50_us", ".0f")
    wrong = [f"{name}: {said}" for name, one in (("first", first), ("second", second)) if (said := problems(one))]
    return (
        f"| {load.name} | {len(first)} | {rate} | {p50} | {medians(CPU_KEY, '.1f')} | {'; '.join(wrong) or 'nothing'} |"
    )


def problems(results: list[Result]) -> str:
    """What went wrong in these runs, in words."""
    wrong = {name: int(sum(result.get(name, 0) for result in results)) for name in PROBLEMS}
    return ", ".join(f"{count} {name}" for name, count in wrong.items() if count)


if __name__ == "__main__":
    main()

"""The agent under load over UDP on this machine: the loads of a C generator, beside the genuine agent's figures.

    python bench/agent.py [--quick] [--write]

Needs gcc for the generator (`xrce_load.c`). Agent and generator get a core each. `--write` puts the table into
docs/explain/performance.md.
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
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from bench.machine import describe_machine

SOURCE = Path(__file__).with_name("xrce_load.c")
PAGE = Path(__file__).parent.parent / "docs/explain/performance.md"
PING = bytes.fromhex("80000000 02010800 000afffd 02000000")
BEGIN, END = "<!-- bench/agent.py begins -->", "<!-- bench/agent.py ends -->"


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
    options.add_argument("--write", action="store_true", help=f"put the table into {PAGE.name}")
    chosen = options.parse_args()
    runs, seconds = (1, 1) if chosen.quick else (3, 3)
    generator = build_generator()
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
    if chosen.write:
        write(lines)


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


def run(generator: Path, load: Load, seconds: int, *options: str) -> Result:
    """One run against a fresh agent, which is started with these options besides."""
    with agent(*options) as (port, pid):
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
def agent(*options: str) -> Iterator[tuple[int, int]]:
    """`msbot agent udp4` on a free port and a core of its own: (port, process)."""
    port = free_port()
    process = start_agent(port, *options)
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


def start_agent(port: int, *options: str) -> subprocess.Popen[bytes]:
    """`msbot agent udp4` on a core of its own; the caller ends it."""
    return subprocess.Popen(
        [*pinned(0), sys.executable, "-m", "msbot", "agent", "udp4", "-p", str(port), "-v", "1", *options],
        stdout=subprocess.DEVNULL,
    )


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
    cpu = statistics.median(result.get("agent_cpu_us_per_msg", 0.0) for result in results)
    wrong = {name: int(sum(result.get(name, 0) for result in results)) for name in PROBLEMS}
    said = ", ".join(f"{count} {name}" for name, count in wrong.items() if count) or "nothing"
    peer = "-" if load.peer_rate is None else f"{load.peer_rate:,.0f}"
    peer_cpu = "-" if load.peer_cpu_us is None else f"{load.peer_cpu_us:g}"
    ratio = "-" if load.peer_rate is None else f"{rate / load.peer_rate:.2f}"
    return (
        f"| {load.name} | {rate:,.0f} | {spread:.0%} | {p50:.0f} / {p99:.0f} | {cpu:.1f} | {said} "
        f"| {peer} | {peer_cpu} | {ratio} |"
    )


def write(lines: list[str]) -> None:
    """Put the table between the marks of the page."""
    text = PAGE.read_text()
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    PAGE.write_text(f"{before}{BEGIN}\n\n" + "\n".join(lines) + f"\n\n{END}{after}")


if __name__ == "__main__":
    main()

"""Programs of others with `msbot agent` and, beside it, with other agents: `bench/results/peers.md`.

    python -m bench.peers --examples FOLDER --demos FOLDER --libraries 'FOLDER/{transport}:FOLDER'
        --agent 'MicroXRCEAgent={transport} {where} -m dds=FOLDER/bin/MicroXRCEAgent' --of 'client 3.0.1' [--write]

The programs are built elsewhere; `bench/peers.toml` says how each is started and what it prints when all is well:
examples of Micro XRCE-DDS Client in the tree of its build, demos of micro-ROS in one folder, with the folders of the
libraries that they need for a transport (udp, tcp, serial). Each run has an agent, a network with nothing but the
loopback interface, and pairs of pseudo-terminals for serial lines of its own; needs root.

`--agent NAME=ARGUMENTS=PROGRAM` is one to compare with. In its arguments, {transport} is udp4, tcp4, serial or
multiserial, {where} the port or the serial devices (and `-d`, and `-r FILE` with `--references FILE`).
"""

from __future__ import annotations

import argparse
import os
import pty
import re
import select
import shlex
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
import tty
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from bench.machine import describe_machine
from bench.result import write_result
from tests.space.own_network import inside, open_network

PROGRAMS = Path(__file__).with_suffix(".toml")
HOST, PORT = "127.0.0.1", 8888
START_S, SETTLE_S, KEY_S = 20.0, 0.3, 0.5
"""For an agent to open its port; then until clients come; between two typed lines."""
OURS = "`msbot agent`"
FAILED = re.compile(r"Failed status|^Error|Status error", re.M)


@dataclass(frozen=True)
class Process:
    """One of a program's processes."""

    run: str
    after: float = 0.0
    prints: dict[str, int] = field(default_factory=dict)
    ends: bool = False
    failures: bool = False
    """It says that something failed, and goes on as it should."""
    type: tuple[str, ...] = ()


@dataclass(frozen=True)
class Program:
    """What is started together, and how long it may take."""

    name: str
    of: str
    process: tuple[Process, ...]
    transports: tuple[str, ...] = ()
    seconds: float = 8.0
    port: int = PORT
    discovery: bool = False
    references: bool = False
    middleware: str = ""
    remark: str = ""


@dataclass(frozen=True)
class Agent:
    """An agent and its arguments."""

    name: str
    arguments: str
    program: tuple[str, ...]

    @property
    def is_ours(self) -> bool:
        """Whether it is MsBOT, perhaps with arguments of its own."""
        return "msbot" in self.program


@dataclass(frozen=True)
class Places:
    """Where the programs of others are."""

    examples: str
    demos: str
    libraries: str
    references: str

    def of(self, program: Program) -> str:
        """The folder of a program's executables; empty: they are not here."""
        return self.examples if program.of == "examples" else self.demos


def programs() -> list[Program]:
    """All that `bench/peers.toml` names."""
    found = []
    for table in tomllib.loads(PROGRAMS.read_text("utf-8"))["program"]:
        usual = ("udp4", "tcp4", "serial") if table["of"] == "demos" else ("udp4",)
        lines = tuple(Process(**{**one, "type": tuple(one.get("type", ()))}) for one in table["process"])
        found.append(Program(**{**table, "process": lines, "transports": tuple(table.get("transports", usual))}))
    return found


@contextmanager
def serial_lines(count: int) -> Iterator[list[tuple[str, str]]]:
    """So many serial lines: the device at the agent's end of each, and that at the client's."""
    pairs = [(pty.openpty(), pty.openpty()) for _ in range(count)]
    other: dict[int, int] = {}
    for here, there in pairs:
        other |= {here[0]: there[0], there[0]: here[0]}
        for one in (*here, *there):
            tty.setraw(one)
    over = threading.Event()

    def carry() -> None:
        while not over.is_set():
            for one in select.select(list(other), [], [], 0.2)[0]:
                octets = os.read(one, 4096)
                while octets:
                    octets = octets[os.write(other[one], octets) :]

    carrier = threading.Thread(target=carry)
    carrier.start()
    try:
        yield [(os.ttyname(here[1]), os.ttyname(there[1])) for here, there in pairs]
    finally:
        over.set()
        carrier.join()
        for here, there in pairs:
            for one in (*here, *there):
                os.close(one)


class Run:
    """One program over one transport with one agent."""

    def __init__(self, program: Program, transport: str, agent: Agent, places: Places, folder: Path) -> None:
        self.program, self.transport, self.agent = program, transport, agent
        self._places, self._folder = places, folder

    def is_well(self) -> bool:
        """Whether every process printed what it should."""
        count = len(self.program.process) if self.transport == "serial" else 0
        with serial_lines(count) as lines, self._agent([line[0] for line in lines]):
            return self._processes([line[1] for line in lines])

    @contextmanager
    def _agent(self, devices: Sequence[str]) -> Iterator[None]:
        where = ["-D", " ".join(devices)] if devices else ["-p", str(self.program.port)]
        if self.program.discovery:
            where.append("-d")
        if self.program.references and self._places.references:
            where += ["-r", self._places.references]
        transport = "multiserial" if len(devices) > 1 else self.transport
        arguments = [
            part
            for word in self.agent.arguments.split()
            for part in (where if word == "{where}" else [word.format(transport=transport)])
        ]
        if self.agent.is_ours and self.program.middleware:
            arguments += ["-m", self.program.middleware]
        home = self._folder / "home"
        home.mkdir(mode=0o700)
        log = self._folder / "agent"
        with log.open("wb") as out:
            # Some agents end when their standard input does.
            agent = subprocess.Popen(
                [*self.agent.program, *arguments],
                stdin=subprocess.PIPE,
                stdout=out,
                stderr=subprocess.STDOUT,
                cwd=self._folder,
                env={**os.environ, "XDG_RUNTIME_DIR": str(home)},
            )
        try:
            self._wait_for(agent, log)
            yield
        finally:
            agent.terminate()
            try:
                agent.communicate(timeout=5)
            except subprocess.TimeoutExpired:
                agent.kill()
                agent.communicate()

    def _wait_for(self, agent: subprocess.Popen[bytes], log: Path) -> None:
        """Until it has opened its port; one that is at a serial line says so, or is given a second."""
        table = Path("/proc/thread-self/net") / self.transport.removesuffix("4")
        start = time.monotonic()
        while time.monotonic() - start < START_S and agent.poll() is None:
            if self.transport != "serial":
                is_ready = f":{self.program.port:04X} " in table.read_text()
            elif self.agent.is_ours:
                is_ready = b"agent on" in log.read_bytes()
            else:
                is_ready = time.monotonic() - start > 1
            if is_ready:
                break
            time.sleep(0.1)
        time.sleep(SETTLE_S)

    def _processes(self, devices: Sequence[str]) -> bool:
        running = []
        environment = dict(os.environ)
        if self.program.of == "demos":
            environment["LD_LIBRARY_PATH"] = self._places.libraries.format(transport=self.transport.removesuffix("4"))
        for number, process in enumerate(self.program.process):
            time.sleep(process.after)
            place = self._folder / str(number)
            place.mkdir()
            if devices:
                (place / "tty").symlink_to(devices[number])
                (place / "tty0").symlink_to(devices[number])
            at = f"{HOST} {self.program.port}"
            words = process.run.format(
                at=at, transport=self.transport, tty_or_at="tty" if self.transport == "serial" else at
            ).split()
            words[0] = str(Path(self._places.of(self.program)) / words[0])
            with (place / "out").open("wb") as out:
                one = subprocess.Popen(
                    ["stdbuf", "-oL", *words],
                    stdin=subprocess.PIPE,
                    stdout=out,
                    stderr=subprocess.STDOUT,
                    cwd=place,
                    env={**environment, "ROS_LOG_DIR": str(place)},
                )
            running.append((one, process, place / "out"))
            if process.type:
                threading.Thread(target=type_lines, args=(one, process.type)).start()
        end = time.monotonic() + self.program.seconds
        while time.monotonic() < end and any(one.poll() is None for one, _, _ in running):
            time.sleep(0.1)
        well = True
        for one, process, printed in running:
            ended = one.poll()
            if ended is None:
                one.terminate()
                one.wait()
            text = printed.read_text("utf-8", errors="replace")
            well &= all(len(re.findall(pattern, text)) >= least for pattern, least in process.prints.items())
            well &= process.failures or not FAILED.search(text)
            well &= ended == 0 if process.ends else ended is None or ended >= 0
        return well


def type_lines(process: subprocess.Popen[bytes], lines: Sequence[str]) -> None:
    """Type lines into a program, one after the other."""
    assert process.stdin is not None
    for line in lines:
        try:
            process.stdin.write(line.encode() + b"\n")
            process.stdin.flush()
        except OSError:
            return  # it has ended
        time.sleep(KEY_S)


def tried(runs: Sequence[Run], at_once: int) -> Counter[tuple[str, str, str]]:
    """How often each was well, by program, transport and agent."""

    def one(run: Run) -> bool:
        network = open_network()
        try:
            with inside(network):
                for words in ("link set lo up multicast on", "route add 239.0.0.0/8 dev lo"):
                    subprocess.run(["ip", *words.split()], check=True)
                return run.is_well()
        finally:
            os.close(network)

    well: Counter[tuple[str, str, str]] = Counter()
    with ThreadPoolExecutor(at_once) as pool:
        for run, is_well in zip(runs, pool.map(one, runs), strict=True):
            well[run.program.name, run.transport, run.agent.name] += is_well
            words = "well" if is_well else "not well"
            print(f"{words}: {run.program.name}, {run.transport}, {run.agent.name}", file=sys.stderr, flush=True)
    return well


SHORT = {"udp4": "UDP", "tcp4": "TCP", "serial": "serial"}


def cell(counts: Sequence[tuple[str, int]], times: int) -> str:
    """One program with one agent: in one word if it went alike over all transports."""
    words = {SHORT[transport]: _word(count, times) for transport, count in counts}
    if len(set(words.values())) == 1:
        return next(iter(words.values()))
    return ", ".join(f"{transport} {word}" for transport, word in words.items())


def _word(count: int, times: int) -> str:
    return "yes" if count == times else "no" if count == 0 else f"{count} of {times}"


def table(
    chosen: Sequence[Program], agents: Sequence[Agent], well: Counter[tuple[str, str, str]], times: int
) -> list[str]:
    """How many runs were well with which agent, and then which."""
    names = [agent.name for agent in agents]
    lines = [f"| runs that went well | {' | '.join(names)} |", f"|---|{'---|' * len(agents)}"]
    for kind in dict.fromkeys(program.of for program in chosen):
        for transport, words in SHORT.items():
            mine = [program.name for program in chosen if program.of == kind and transport in program.transports]
            counts = [sum(well[name, transport, agent] for name in mine) for agent in names]
            if mine:
                cells = " | ".join(f"{count} of {len(mine) * times}" for count in counts)
                lines.append(f"| {kind} over {words} | {cells} |")
    for kind in dict.fromkeys(program.of for program in chosen):
        lines += ["", f"| {kind} | over | {' | '.join(names)} | |", f"|---|---|{'---|' * len(agents)}---|"]
        for program in chosen:
            if program.of == kind:
                cells = " | ".join(
                    cell([(one, well[program.name, one, agent]) for one in program.transports], times)
                    for agent in names
                )
                over = ", ".join(SHORT[one] for one in program.transports)
                lines.append(f"| {program.name} | {over} | {cells} | {program.remark} |")
    return lines


def chosen_agents(texts: Sequence[str]) -> list[Agent]:
    """Ours, and those that are named."""
    agents = [Agent(OURS, "{transport} {where}", (sys.executable, "-m", "msbot", "agent"))]
    for text in texts:
        name, arguments, program = text.split("=", 2)
        agents.append(Agent(name, arguments, tuple(shlex.split(program))))
    return agents


def main() -> None:
    """Run them, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--examples", default="", help="the folder with the examples of a build of the client")
    parser.add_argument("--demos", default="", help="the folder with the demos of micro-ROS")
    parser.add_argument("--libraries", default="", help="the folders of their libraries, with {transport} in them")
    parser.add_argument("--references", default="", help="profiles (XML) that the agents are given where needed")
    parser.add_argument("--agent", action="append", default=[], metavar="NAME=ARGUMENTS=PROGRAM", help="another agent")
    parser.add_argument("--of", required=True, help="whose programs these are, with the versions")
    parser.add_argument("--only", default="", metavar="PATTERN", help="programs with such a name")
    parser.add_argument("--times", type=int, default=1, help="how often each is run")
    parser.add_argument("--at-once", type=int, default=3, help="how many run beside each other")
    parser.add_argument("--keep", metavar="FOLDER", help="keep what all of them printed there")
    parser.add_argument("--write", action="store_true", help="keep the table in bench/results")
    arguments: Any = parser.parse_args()
    places = Places(arguments.examples, arguments.demos, arguments.libraries, arguments.references)
    chosen = [one for one in programs() if places.of(one) and re.search(arguments.only, one.name)]
    agents = chosen_agents(arguments.agent)
    with tempfile.TemporaryDirectory() as made:
        runs: list[Run] = []
        for program in chosen:
            for transport in program.transports:
                for agent in agents:
                    for _ in range(arguments.times):
                        folder = Path(arguments.keep or made) / str(len(runs))
                        folder.mkdir(parents=True)
                        runs.append(Run(program, transport, agent, places, folder))
        well = tried(runs, arguments.at_once)
    date = datetime.now(UTC).strftime("%-d %B %Y")
    lines = [
        f"{describe_machine()}, {date}; {arguments.of}. Each was run {arguments.times} times.",
        "",
        *table(chosen, agents, well, arguments.times),
    ]
    print("\n".join(lines))
    if arguments.write:
        title = "Programs of others with `msbot agent` and with other agents"
        write_result("peers", title, lines, made_by="python -m bench.peers ... --write")


if __name__ == "__main__":
    main()

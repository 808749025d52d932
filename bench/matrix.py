"""What robots of others do not come back from, each a hundred times: how often ours does, and how fast.

    python -m bench.matrix [--rounds 100] [--only kill,cycle] [--write]

The rows are the complaints that users of other agents make most: the agent killed, a part switched off and on, its
adapter pulled out, foreign traffic, equal ids, more than nine clients, messages larger than a packet. Real processes;
a round is right if every part concerned is active and hears samples within 3 s, counted from the moment when that is
possible: the master serves, the part's program runs, the adapter is there. `--write` puts the table into
bench/results/recovery.md. Exit status 1 unless all rounds are right. `--bus can:vcan0` uses a bus of the kernel, and
`replug` then puts the interface down and up. Linux; where other
masters run, in a network of its own (`unshare -n`, `ip link set lo up`): a STOP for all of a computer reaches it, too.
"""

from __future__ import annotations

import argparse
import asyncio
import math
import os
import signal
import statistics
import sys
import tempfile
import time
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from bench.machine import describe_machine
from bench.result import write_result
from bench.soaking.adapter import SerialAdapter
from bench.soaking.robot import Robot

LIMIT_S = 3.0
PATIENCE_S = 60.0
"""What is not back by then is not coming back."""
CROWD = 20
TWINS = 2
FOREIGN = "001#DEADBEEF01020304"
"""Before all frames of MsBOT on a CAN bus."""


@dataclass(slots=True)
class Row:
    """What came of one kind of trouble."""

    title: str
    times: list[float] = field(default_factory=list)
    """Seconds until all was well again; infinite: never."""
    wrong: int = 0
    """Rounds in which something else was wrong."""
    notes: list[str] = field(default_factory=list)

    @property
    def right(self) -> int:
        """Rounds that were right."""
        return sum(one <= LIMIT_S for one in self.times) - self.wrong

    def words(self) -> str:
        """As a row of a table."""
        found = sorted(one for one in self.times if one < math.inf)
        if not found:
            return f"| {self.title} | 0 of {len(self.times)} | - | {'; '.join(self.notes)} |"
        late = found[math.ceil(0.95 * len(found)) - 1]
        return (
            f"| {self.title} | {self.right} of {len(self.times)} | {statistics.median(found):.2f} s, {late:.2f} s, "
            f"{found[-1]:.2f} s | {'; '.join(self.notes)} |"
        )


class Stage:
    """A robot and what its parts have said."""

    def __init__(self, folder: Path, kinds: list[str], authentication: str = "open") -> None:
        self.robot = Robot(folder, kinds, authentication, Random(1), self._hear)
        self.joined: dict[str, tuple[float, str]] = {}
        """By part: when it has joined last, and which process."""
        self.lost: dict[str, int] = {}
        self.heard: dict[str, float] = {}
        self.numbers: dict[tuple[str, str], deque[tuple[str, int, int]]] = {}
        """By hearer and process: whose sample it has heard."""
        self.refused = 0
        """Samples that were not taken, in words: larger than a packet, on a best-effort wire."""
        self._news = asyncio.Event()

    def _hear(self, name: str, event: list[object]) -> None:
        at, boot = float(str(event[1])), str(event[2])
        if event[0] == "join":
            self.joined[name] = (at, boot)
        elif event[0] == "lost":
            self.lost[name] = self.lost.get(name, 0) + 1
        elif event[0] == "refused":
            self.refused += 1
        elif event[0] == "got":
            self.heard[name] = at
            _, _, _, _, _, its_boot, epoch, number = event
            found = self.numbers.setdefault((name, boot), deque(maxlen=5000))
            found.append((str(its_boot), int(str(epoch)), int(str(number))))
        self._news.set()

    async def until(self, condition: Callable[[], bool]) -> bool:
        """Wait for what they say; False: it never comes."""
        try:
            async with asyncio.timeout(PATIENCE_S):
                while not condition():
                    self._news.clear()
                    await self._news.wait()
        except TimeoutError:
            return False
        return True

    async def all_well(self, since: float, *slots: str) -> float:
        """How long after that moment these parts were active and heard something; infinite: never."""
        names = slots or tuple(self.robot.slots)

        def is_well() -> bool:
            # Samples that were on their way before the trouble do not count: only those heard after a part is back.
            return all(name in self.joined and self.heard.get(name, 0.0) > since for name in names)

        if not await self.until(is_well):
            return math.inf
        return max(0.0, max(self.heard[name] for name in names) - since)

    def doubled_or_lost(self) -> list[str]:
        """Samples that came twice, too late, or not at all, within a life of both ends."""
        found = []
        for (name, _), numbers in self.numbers.items():
            before: dict[tuple[str, int], int] = {}
            for boot, epoch, number in numbers:
                last = before.get((boot, epoch), number - 1)
                if number != last + 1:
                    found.append(f"{name} hears {number} after {last}")
                before[boot, epoch] = number
        return found

    async def start(self, *, parts: bool = True) -> None:
        """The master and all parts, until all is well."""
        await self.robot.start_bus()
        await self.robot.start_master()
        if parts:
            for slot in self.robot.slots:
                await self.robot.start_part(slot)
            if await self.all_well(time.monotonic()) == math.inf:
                raise SystemExit(f"the robot does not come up: {self.joined}, {self.heard}")


@asynccontextmanager
async def stage(
    *kinds: str, prepare: Callable[[Stage, Path], None] = lambda _stage, _folder: None
) -> AsyncIterator[Stage]:
    """A robot of its own."""
    with tempfile.TemporaryDirectory() as name:
        one = Stage(Path(name), list(kinds))
        await one.robot.prepare()
        prepare(one, Path(name))
        try:
            yield one
        finally:
            await one.robot.close()


def tell(row: Row, number: int) -> None:
    """How it goes."""
    if number % 10 == 9:
        print(f"    {number + 1:4} {row.words()}", flush=True)


# The rows.


async def kill(rounds: int, bus: str) -> Row:
    """The master, and with it the agent, is killed and started again, under parts on four kinds of link."""
    row, whole = Row("the agent is killed (`kill -9`) and started again; parts on UDP, TCP, WebSocket and CAN"), []
    async with stage("udp", "tcp", "ws", bus) as it:
        await it.start()
        for number in range(rounds):
            killed = time.monotonic()
            await it.robot.end(it.robot.master, signal.SIGKILL)
            it.joined.clear()
            await it.robot.start_master()
            up = time.monotonic()
            row.times.append(await it.all_well(up))
            whole.append(time.monotonic() - killed)
            tell(row, number)
        row.notes.append(f"from the kill on {statistics.median(whole):.1f} s (median)")
    return row


async def cycle(rounds: int, bus: str) -> Row:
    """Parts are killed and started again."""
    row = Row("a part is switched off and on (`kill -9`); on UDP, TCP and CAN")
    cycled = ("S1", "S3", "S5")
    """Each hears one that stays on."""
    async with stage("udp", "udp", "udp", "tcp", "udp", bus) as it:
        await it.start()
        for number in range(math.ceil(rounds / len(cycled))):
            row.times += await asyncio.gather(*(_cycle(it, slot) for slot in cycled))
            tell(row, number)
    return row


async def _cycle(it: Stage, slot: str) -> float:
    """Switch a part off and on; gives the seconds until it hears again, from the moment when its program runs."""
    member = it.robot.members[slot]
    await it.robot.end(member.process, signal.SIGKILL)
    it.joined.pop(slot, None)
    await it.robot.start_part(slot)
    if not await it.until(lambda: bool(member.boot)):
        return math.inf
    return await it.all_well(time.monotonic(), slot)


async def replug(rounds: int, bus: str) -> Row:
    """The adapter is pulled out and plugged in: a serial one, or the interface of a bus of the kernel."""
    if bus.startswith("can:"):
        return await _interface_down_and_up(rounds, bus)
    row = Row("the serial adapter is pulled out and plugged in again")
    adapters: list[SerialAdapter] = []

    def prepare(it: Stage, folder: Path) -> None:
        adapters.append(SerialAdapter(folder, "usb0"))
        it.robot.members["S0"].kind = f"serial:{adapters[0].part}"
        it.robot.more_links = [f"serial:{adapters[0].master}"]
        adapters[0].plug()

    async with stage("serial", "udp", prepare=prepare) as it:
        await it.start()
        (adapter,) = adapters
        for number in range(rounds):
            adapter.pull()
            lost = it.lost.get("S0", 0)
            if not await it.until(lambda lost=lost: it.lost.get("S0", 0) > lost):  # type: ignore[misc]
                row.wrong += 1
            it.joined.pop("S0", None)
            adapter.plug()
            row.times.append(await it.all_well(time.monotonic()))
            tell(row, number)
        adapter.pull()
    return row


async def _interface_down_and_up(rounds: int, bus: str) -> Row:
    """With a bus of the kernel."""
    row = Row(f"the interface {bus} goes down and up again")
    name = bus.removeprefix("can:").partition("?")[0]
    async with stage(bus, bus) as it:
        await it.start()
        for number in range(rounds):
            await _ip("link", "set", name, "down")
            lost = sum(it.lost.values())
            await it.until(lambda lost=lost: sum(it.lost.values()) >= lost + 2)  # type: ignore[misc]
            it.joined.clear()
            await _ip("link", "set", name, "up")
            row.times.append(await it.all_well(time.monotonic()))
            tell(row, number)
    return row


async def _ip(*words: str) -> None:
    process = await asyncio.create_subprocess_exec("ip", *words)
    if await process.wait():
        raise SystemExit(f"ip {' '.join(words)} fails")


async def foreign(rounds: int, bus: str) -> Row:
    """Others fill the bus with frames that go before all others, and parts are switched off and on meanwhile."""
    row = Row("a part on CAN is switched off and on beside foreign frames, about 500 a second, that go first")
    async with stage(bus, bus) as it:
        await it.start()
        noise = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "msbot",
            "bus",
            "send",
            it.robot.bus or "",
            FOREIGN,
            "--repeat",
            "10000000",
            "--period",
            "0.002",
            env=it.robot.environment,
            stdout=asyncio.subprocess.DEVNULL,
        )
        try:
            for number in range(rounds):
                row.times.append(await _cycle(it, "S0"))
                tell(row, number)
            if noise.returncode is not None:
                raise SystemExit("the noise has ended")
        finally:
            await Robot.end(noise, signal.SIGKILL)
    return row


async def equal(rounds: int, _bus: str) -> Row:
    """Others show the UID of parts that are there: they never get in, and nobody notices anything."""
    row = Row("a second part with the same UID and number, by UDP and TCP: it stays out, the first loses nothing")
    async with stage("udp", "tcp", "udp") as it:
        await it.start()
        before = dict(it.lost)
        for number in range(math.ceil(rounds / TWINS)):
            twins = [await _twin(it, slot) for slot in it.robot.slots[:TWINS]]
            await asyncio.sleep(LIMIT_S)
            for twin in twins:
                await Robot.end(twin, signal.SIGKILL)
                assert twin.stdout is not None
                row.wrong += b'["join"' in await twin.stdout.read()
                row.times.append(await it.all_well(time.monotonic()))
            tell(row, number)
        row.wrong += it.lost != before
        row.notes += ["here the time until the next sample is heard", *_samples(row, it)]
    return row


async def _twin(it: Stage, slot: str) -> asyncio.subprocess.Process:
    member = it.robot.members[slot]
    return await asyncio.create_subprocess_exec(
        sys.executable,
        "-m",
        "bench.soaking.part_program",
        slot,
        "--uid",
        member.uid.hex(),
        "--link",
        f"{member.kind}:127.0.0.1:{it.robot.link_port}",
        env=it.robot.environment,
        cwd=Path(__file__).parent.parent,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.DEVNULL,
    )


def _samples(row: Row, it: Stage) -> list[str]:
    """What became of the samples: wrong ones make rounds wrong."""
    wrong = it.doubled_or_lost()
    row.wrong += len(wrong)
    heard = sum(map(len, it.numbers.values()))
    return [f"{heard} samples heard, {len(wrong)} lost or doubled"]


async def crowd(rounds: int, _bus: str) -> Row:
    """Twenty clients, and all of them again after the agent was killed."""
    row = Row(f"{CROWD} clients at once over UDP, after the agent was killed and started again")
    async with stage(*["udp"] * CROWD) as it:
        await it.start()
        for number in range(math.ceil(rounds / 10)):
            await it.robot.end(it.robot.master, signal.SIGKILL)
            it.joined.clear()
            await it.robot.start_master()
            row.times.append(await it.all_well(time.monotonic()))
            tell(row, number)
    return row


async def large(rounds: int, bus: str) -> Row:
    """Samples larger than a packet, on reliable and best-effort wires."""
    row = Row("samples of 1,500 to 3,000 bytes among others on UDP, TCP and CAN, reliable and best effort")
    async with stage("udp", "tcp", bus, "udp", "udp") as it:
        await it.start()
        for number in range(rounds):
            before = time.monotonic()
            row.times.append(await it.all_well(before))
            await asyncio.sleep(0.5)
            tell(row, number)
        row.notes += ["here the time until the next sample is heard", *_samples(row, it)]
        row.notes.append(f"on the best-effort wire refused with a sentence: {it.refused}")
        row.wrong += not it.refused
    return row


ROWS: dict[str, Callable[[int, str], Awaitable[Row]]] = {
    "kill": kill, "cycle": cycle, "replug": replug, "foreign": foreign, "equal": equal, "crowd": crowd, "large": large,
}  # fmt: skip


async def measure(options: argparse.Namespace) -> list[Row]:
    """All rows that are wanted; SIGTERM ends it in good order."""
    this = asyncio.current_task()
    assert this is not None
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, this.cancel)
    rows = []
    for name in options.only.split(",") if options.only else ROWS:
        print(f"{name}: {(ROWS[name].__doc__ or '').strip()}", flush=True)
        rows.append(await ROWS[name](options.rounds, options.bus or f"sim:matrix{os.getpid()}"))
        print(rows[-1].words(), flush=True)
    return rows


def table(rows: list[Row]) -> str:
    """For people."""
    lines = ["| what happens | right within 3 s | well again after: median, 95 %, longest | |", "|---|---|---|---|"]
    load = ", ".join(f"{one:.1f}" for one in os.getloadavg())
    return "\n".join(
        [
            *lines,
            *(row.words() for row in rows),
            "",
            f"On {time.strftime('%Y-%m-%d')}, {describe_machine()}; load {load}.",
        ]
    )


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=100, help="of each kind; a tenth of it with the crowd")
    parser.add_argument("--only", help=f"some of {', '.join(ROWS)}")
    parser.add_argument("--bus", help="a bus instead of a simulated one, for example can:vcan0")
    parser.add_argument("--write", action="store_true", help="keep it in bench/results")
    options = parser.parse_args()
    rows = asyncio.run(measure(options))
    words = table(rows)
    print(words)
    if options.write:
        title = "A robot comes back from every trouble"
        write_result("recovery", title, words.splitlines(), made_by="python -m bench.matrix --write")
    sys.exit(0 if all(row.right == len(row.times) for row in rows) else 1)


if __name__ == "__main__":
    main()

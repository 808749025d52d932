"""Cuts of the power while changes are being made: what was acknowledged has to be there after the next start."""

from __future__ import annotations

import math
import random
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import httpx

from tools.card_image.base import ImageError
from tools.card_image.forgetful_disk import Moment
from tools.card_image.robot import DISK_IS_SLOW, NAME, Robot, say, wait_for

MOMENTS = (Moment.FLUSH, Moment.WRITE, Moment.FLUSH, Moment.ANY)
"""Where the cuts come, in turn."""
HOLDING = (1, 64)
"""Sectors that are written and not flushed then: from, to. A change of the database has about 30."""
MOST_TOKENS = 40
"""Of a cut: a person has 50 at most."""
MOMENT_S = 60.0
"""How long such a moment may take to come; then the cut comes at any."""


@dataclass(frozen=True, slots=True)
class Acknowledged:
    """What has to be there; a change on its way may have been made, or not."""

    tokens: frozenset[str]
    programs: dict[str, frozenset[str | None]]
    """By name: the texts that it may have; None: there may be none."""
    bitrates: frozenset[object]

    def missing(self, tokens: set[str], program: Callable[[str], str | None], bitrate: object) -> list[str]:
        """What is not there.

        Args:
            tokens: the names that there are.
            program: the text of one; None: it is not there.
            bitrate: the one that is set.
        """
        lost = [f"the token {name!r}" for name in sorted(self.tokens - tokens)]
        for name, texts in self.programs.items():
            if (found := program(name)) not in texts:
                lost.append(f"{name!r}: {found!r} in place of {sorted(map(str, texts))}")
        if bitrate not in self.bitrates:
            lost.append(f"the bit rate: {bitrate} in place of {sorted(map(str, self.bitrates))}")
        return lost


class Changes:
    """Makes changes of three kinds at a time, and knows which were acknowledged.

    Args:
        robot: whose.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._number = 0
        self._lock = threading.Lock()
        self.acknowledged = 0
        self._tokens: set[str] = set()
        self._programs: dict[str, frozenset[str | None]] = {}
        self._bitrates: frozenset[object] = frozenset()
        self.refused = ""
        """Why a change was refused: then the trial itself is wrong."""

    def begin(self, over: threading.Event) -> list[threading.Thread]:
        """Make changes until nobody answers any more, or it is over."""
        self._bitrates = frozenset({self._robot.bitrate()})
        kinds = (self._token, self._program_text, self._rate)
        makers = [threading.Thread(target=self._make_until, args=(over, kind), daemon=True) for kind in kinds]
        for maker in makers:
            maker.start()
        return makers

    def _make_until(self, over: threading.Event, change: Callable[[int], None]) -> None:
        while not over.is_set():
            with self._lock:
                self._number += 1
                number = self._number
            try:
                change(number)
            except httpx.HTTPError:
                return
            except ImageError as error:
                if DISK_IS_SLOW.search(str(error)):
                    continue
                self.refused = str(error)
                return
            with self._lock:
                self.acknowledged += 1

    def _token(self, number: int) -> None:
        if len(self._tokens) >= MOST_TOKENS:
            return self._program_text(number, "other")
        name = f"cut {number}"
        self._robot.ask("POST", f"/api/users/{NAME}/tokens", {"words": name})
        with self._lock:
            self._tokens.add(name)

    def _program_text(self, number: int, kind: str = "program") -> None:
        name, text = f"{kind}-{number % 5}.py", f"# {number}\n"
        with self._lock:
            self._programs[name] = self._programs.get(name, frozenset({None})) | {text}
        self._robot.ask("PUT", f"/api/programs/{name}", {"text": text})
        with self._lock:
            self._programs[name] = frozenset({text})

    def _rate(self, number: int) -> None:
        rate = 100_000 + number
        with self._lock:
            self._bitrates |= {rate}
        self._robot.ask("PATCH", "/api/card", {"hardware": {"can_bitrate": rate}})
        with self._lock:
            self._bitrates = frozenset({rate})

    def now(self) -> Acknowledged:
        """What has to be there if the power goes now."""
        with self._lock:
            return Acknowledged(frozenset(self._tokens), dict(self._programs), self._bitrates)

    def missing(self) -> list[str]:
        """What was acknowledged and is not there; then the tokens are removed."""
        tokens = self._robot.tokens(NAME)
        lost = self.now().missing(tokens, self._robot.program, self._robot.bitrate())
        for name in self._programs:
            self._programs[name] = frozenset({self._robot.program(name)})
        for name in sorted(tokens):
            if name.startswith("cut "):  # a person has 50 at most
                self._remove(name)
        self._tokens.clear()
        return lost

    def _remove(self, token: str) -> None:
        try:
            self._robot.ask("DELETE", f"/api/users/{NAME}/tokens/{token}")
        except ImageError as error:
            if not DISK_IS_SLOW.search(str(error)):
                raise
            # It was on its way, and may have been made; at the next time it is seen.


@dataclass(frozen=True, slots=True)
class Cut:
    """What came of one."""

    number: int
    moment: Moment
    made: int
    """Changes that were acknowledged before it."""
    waiting: int
    """Sectors that were written and not flushed."""
    dropped: int
    """Of these, lost."""
    seconds: float
    """From the power to the page."""

    @property
    def row(self) -> str:
        """A line of the table."""
        return (
            f"| {self.number} | {self.moment.value} | {self.made} | {self.waiting} | {self.dropped} | "
            f"{self.seconds:.0f} | 0 |"
        )


class Numbers:
    """Numbers of cuts, for several machines at a time; none any more when the time is over.

    Args:
        count: how many.
        within_s: from now on.
    """

    def __init__(self, count: int, within_s: float) -> None:
        self._left, self._until, self._lock = iter(range(1, count + 1)), time.monotonic() + within_s, threading.Lock()

    def end(self) -> None:
        """No more."""
        self._until = -math.inf

    def __iter__(self) -> Numbers:
        return self

    def __next__(self) -> int:
        with self._lock:
            if time.monotonic() > self._until:
                raise StopIteration
            return next(self._left)


def try_cuts(robot: Robot, numbers: Numbers, seed: int) -> list[Cut]:
    """Cut the power again and again; returns what came of it.

    Raises:
        ImageError: an acknowledged change is lost.
    """
    chance, changes, done, machine = random.Random(seed), Changes(robot), [], robot.machine
    for number in numbers:
        moment, holding = MOMENTS[(number - 1) % len(MOMENTS)], chance.randint(*HOLDING)
        before, lost_before, kept_before = changes.acknowledged, machine.disk.lost, machine.disk.kept
        over = threading.Event()
        makers = changes.begin(over)

        def has_begun(before: int = before) -> bool:
            return changes.acknowledged > before or bool(changes.refused)

        wait_for(machine, has_begun, "a change")
        time.sleep(chance.uniform(0.5, 8.0))
        if moment is not Moment.ANY:
            machine.disk.stop_at(moment, holding)
            if not machine.disk.wait_until_stopped(MOMENT_S):
                moment = Moment.ANY
        if changes.refused:
            raise ImageError(changes.refused)
        machine.cut_power()
        over.set()
        for maker in makers:
            maker.join()
        made, dropped = changes.acknowledged - before, machine.disk.lost - lost_before
        waiting = dropped + machine.disk.kept - kept_before
        machine.switch_on()
        seconds = robot.wait_for_page()
        if lost := changes.missing():
            raise ImageError(f"cut {number}: acknowledged and lost: {'; '.join(lost)}")
        done.append(Cut(number, moment, made, waiting, dropped, seconds))
        say(done[-1].row)
    return done

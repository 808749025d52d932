"""Cuts of the power while changes are being made: what was acknowledged has to be there after the next start."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import httpx

from tools.card_image.base import ImageError
from tools.card_image.forgetful_disk import Moment
from tools.card_image.robot import NAME, Robot, say, wait_for

MOMENTS = (Moment.FLUSH, Moment.WRITE, Moment.FLUSH, Moment.ANY)
"""Where the cuts come, in turn."""
HOLDING = (1, 64)
"""Sectors that are written and not flushed then: from, to. A change of the database has about 30."""
MOST_TOKENS = 40
"""Of a cut: a person has 50 at most."""
MOMENT_S = 60.0
"""How long such a moment may take to come; then the cut comes at any."""


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
        self._programs: dict[str, set[str | None]] = {}
        """By name: the texts that it may have; None: there may be none."""
        self._bitrates: set[object] = set()
        self.refused = ""
        """Why a change was refused: then the trial itself is wrong."""

    def begin(self, over: threading.Event) -> list[threading.Thread]:
        """Make changes until nobody answers any more; the last of each kind may have been made, or not."""
        self._bitrates = {self._bitrate()}
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
                self.refused = str(error)
                return
            with self._lock:
                self.acknowledged += 1

    def _token(self, number: int) -> None:
        if len(self._tokens) >= MOST_TOKENS:
            return self._program_text(number, "other")
        name = f"cut {number}"
        self._robot.ask("POST", f"/api/users/{NAME}/tokens", {"words": name})
        self._tokens.add(name)

    def _program_text(self, number: int, kind: str = "program") -> None:
        name, text = f"{kind}-{number % 5}.py", f"# {number}\n"
        self._programs[name] = self._programs.get(name, {None}) | {text}
        self._robot.ask("PUT", f"/api/programs/{name}", {"text": text})
        self._programs[name] = {text}

    def _rate(self, number: int) -> None:
        rate = 100_000 + number
        self._bitrates.add(rate)
        self._robot.ask("PATCH", "/api/card", {"hardware": {"can_bitrate": rate}})
        self._bitrates = {rate}

    def missing(self) -> list[str]:
        """What was acknowledged and is not there."""
        lost = []
        people = self._robot.ask("GET", "/api/users")
        tokens = {token for person in people for token in person["tokens"]}  # type: ignore[index]
        lost += [f"the token {name!r}" for name in sorted(self._tokens - tokens)]
        for name, texts in self._programs.items():
            found = self._program(name)
            if found not in texts:
                lost.append(f"{name!r}: {found!r} in place of {texts}")
            self._programs[name] = {found}
        if (rate := self._bitrate()) not in self._bitrates:
            lost.append(f"the bit rate: {rate} in place of {self._bitrates}")
        for name in sorted(tokens):
            if str(name).startswith("cut "):  # a person has 50 at most
                self._robot.ask("DELETE", f"/api/users/{NAME}/tokens/{name}")
        self._tokens.clear()
        return lost

    def _bitrate(self) -> object:
        return self._robot.ask("GET", "/api/card")["settings"]["can_bitrate"]  # type: ignore[index]

    def _program(self, name: str) -> str | None:
        answer = self._robot.client.get(f"/api/programs/{name}")
        if answer.status_code == 404:
            return None
        return str(answer.raise_for_status().json()["text"])


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

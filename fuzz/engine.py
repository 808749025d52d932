"""The fuzzer: makes cases, runs them, keeps those that show something new, makes findings small.

What is new is judged by what a target tells about a case (reasons of drops, kinds of answers, words of errors): that
costs nothing, in contrast to tracing lines in Python.
"""

from __future__ import annotations

import signal
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from types import FrameType

from fuzz.case import Case, Finding, Step, Target, plain, store
from fuzz.mutate import mutate_case

POOL = 400
"""Cases kept for mutation."""
HANG_S = 20.0
"""Seconds of processor time after which a case counts as one that never ends; one takes a few milliseconds."""
REAL_SHARE = 15
"""So many times longer a case may take by the clock."""
SMALLER_TRIES = 600
"""Runs spent on making one finding small."""
SMALLER_S = 60.0
"""Real seconds spent on that: each run of a case that never ends takes `HANG_S` or more."""


class Hang(BaseException):
    """A case takes too long; no `except Exception` on the way may hide it."""


@dataclass(slots=True)
class Report:
    """What came out of fuzzing one target."""

    target: str
    seed: int
    executions: int = 0
    steps: int = 0
    seconds: float = 0.0
    seen: set[str] = field(default_factory=set)
    """Everything the target told, each once."""
    findings: dict[str, int] = field(default_factory=dict)
    """How often each bug was met, by signature."""
    files: list[Path] = field(default_factory=list)

    def __str__(self) -> str:
        rate = self.executions / self.seconds if self.seconds else 0.0
        words = (
            f"{self.target:10} seed {self.seed}: {self.executions:>9,} executions ({rate:,.0f}/s), "
            f"{self.steps:>11,} steps, {len(self.seen):>5} novelties, {len(self.findings)} findings"
        )
        return "\n".join([words, *(f"    {count} x {bug}" for bug, count in self.findings.items())])


def fuzz(
    target: Target,
    *,
    seed: int,
    findings: Path,
    seconds: float | None = None,
    executions: int | None = None,
    told: Callable[[Report], None] = lambda _: None,
) -> Report:
    """Fuzz one target for some real seconds or a number of cases, whichever ends first.

    Args:
        target: what to fuzz.
        seed: the same seed and number of executions give the same cases.
        findings: folder for reproducers.
        seconds: how long; None = no limit.
        executions: how many cases; None = no limit.
        told: called about every 10 s with what there is so far.
    """
    random = Random(seed)
    report = Report(target.name, seed)
    pool: list[Case] = []
    begun = told_at = time.monotonic()
    while executions is None or report.executions < executions:
        report.seconds = time.monotonic() - begun
        if seconds is not None and report.seconds >= seconds:
            break
        if time.monotonic() - told_at > 10.0:
            told_at = time.monotonic()
            told(report)
        case = mutate_case(random, pool) if pool and random.random() < 0.5 else target.make(random)
        report.executions += 1
        report.steps += len(case)
        seen, finding = run_case(target, case)
        if finding is not None:
            _note(target, finding, report, findings)
        elif not seen <= report.seen:
            report.seen |= seen
            pool.append(case)
            if len(pool) > POOL:
                del pool[random.randrange(POOL)]
    report.seconds = time.monotonic() - begun
    return report


def run_case(target: Target, case: Case) -> tuple[set[str], Finding | None]:
    """Run one case; returns what it showed, and the finding if it went wrong."""
    try:
        with time_limit(HANG_S):
            return set(target.run(case)), None
    except (Exception, Hang) as error:
        trace = "".join(traceback.format_exception(error))
        return set(), Finding(target.name, signature(error), trace, case)


def smaller(target: Target, finding: Finding, tries: int = SMALLER_TRIES) -> Finding:
    """The same bug with fewer steps and octets, as far as `tries` runs lead, and `SMALLER_S`."""
    left, until = tries, time.monotonic() + SMALLER_S

    def still_fails(case: Case) -> Finding | None:
        nonlocal left
        left = left - 1 if time.monotonic() < until else 0
        if left <= 0:
            return None
        found = run_case(target, case)[1]
        return found if found is not None and found.signature == finding.signature else None

    size = max(1, len(finding.case) // 2)
    while size and left > 0:
        at = 0
        while at < len(finding.case) and left > 0:
            shorter = still_fails(finding.case[:at] + finding.case[at + size :])
            if shorter is None:
                at += size
            else:
                finding = shorter
        size //= 2
    for at in range(len(finding.case)):
        cut = len(finding.case[at].data) // 2
        while cut and finding.case[at].data and left > 0:
            step = finding.case[at]
            less = Step(step.verb, step.data[:-cut], step.numbers)
            shorter = still_fails((*finding.case[:at], less, *finding.case[at + 1 :]))
            if shorter is None:
                cut //= 2
            else:
                finding = shorter
    return finding


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise Hang in what takes more processor time; does nothing where there are no signals (Windows).

    Real time says nothing on a busy computer; it has a limit as well, for what waits without end.
    """
    if not hasattr(signal, "setitimer"):
        yield
        return

    def rang(_number: int, _frame: FrameType | None) -> None:
        raise Hang(f"more than {seconds} s")

    timers = (
        (signal.SIGPROF, signal.ITIMER_PROF, seconds),
        (signal.SIGALRM, signal.ITIMER_REAL, seconds * REAL_SHARE),
    )
    before = [signal.signal(number, rang) for number, _, _ in timers]
    for _, timer, limit in timers:
        # Again and again: a loop's exception handler may swallow the first one.
        signal.setitimer(timer, limit, 1.0)
    try:
        yield
    finally:
        for (number, timer, _), handler in zip(timers, before, strict=True):
            signal.setitimer(timer, 0)
            signal.signal(number, handler)


def _note(target: Target, finding: Finding, report: Report, folder: Path) -> None:
    known = report.findings.get(finding.signature, 0)
    report.findings[finding.signature] = known + 1
    if not known:
        report.files.append(store(smaller(target, finding), folder, report.seed))


def signature(error: BaseException) -> str:
    """What went wrong and where, in words that are the same for the same mistake."""
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    if error.__cause__ is not None and isinstance(error, AssertionError):
        error = error.__cause__
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if "msbot" in frame.filename]
    frames = frames or list(traceback.extract_tb(error.__traceback__))
    where = f"{Path(frames[-1].filename).name}:{frames[-1].name}" if frames else "?"
    return f"{type(error).__name__} in {where}: {plain(str(error), 100)}"

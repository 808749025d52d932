"""What a case is, and how it is stored."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Step:
    """One thing that happens."""

    verb: str
    data: bytes = b""
    numbers: tuple[float, ...] = ()

    def number(self, index: int, default: float = 0) -> float:
        """A number of the step; mutated steps may lack some."""
        return self.numbers[index] if index < len(self.numbers) else default

    def whole(self, index: int, default: int = 0) -> int:
        """A number of the step as a whole one."""
        return int(self.number(index, default))


Case = tuple[Step, ...]


class Violation(AssertionError):
    """Something that must never happen did; the text says what."""


def plain(words: str, length: int = 60) -> str:
    """The words with all numbers alike, so that a thousand of them are one thing seen."""
    return re.sub(r"\d+", "#", words)[:length]


class Target(Protocol):
    """Something that takes input."""

    name: str
    about: str
    """One line for people: what is fuzzed and what must hold."""

    def make(self, random: Random) -> Case:
        """A new case."""

    def run(self, case: Case) -> Iterable[str]:
        """Run a case, and tell in words what was seen in it; the fuzzer keeps cases that show something new.

        Every exception that comes out of it is a finding.
        """


@dataclass(frozen=True, slots=True)
class Finding:
    """A case that went wrong."""

    target: str
    signature: str
    """What went wrong and where; two findings with one signature are one bug."""
    trace: str
    case: Case


def store(finding: Finding, folder: Path, seed: int) -> Path:
    """Write a finding so that `python -m fuzz --replay FILE` can repeat it; returns the file."""
    folder.mkdir(parents=True, exist_ok=True)
    taken = {path.name for path in folder.glob(f"{finding.target}-{seed}-*.json")}
    number = next(n for n in range(1, len(taken) + 2) if f"{finding.target}-{seed}-{n}.json" not in taken)
    path = folder / f"{finding.target}-{seed}-{number}.json"
    steps = [[step.verb, step.data.hex(), list(step.numbers)] for step in finding.case]
    content = {
        "target": finding.target,
        "signature": finding.signature,
        "steps": steps,
        "trace": finding.trace.splitlines(),
    }
    path.write_text(json.dumps(content, indent=1) + "\n")
    return path


def load(path: Path) -> tuple[str, Case]:
    """The target's name and the case of a stored finding."""
    content = json.loads(path.read_text())
    case = tuple(Step(verb, bytes.fromhex(data), tuple(numbers)) for verb, data, numbers in content["steps"])
    return content["target"], case

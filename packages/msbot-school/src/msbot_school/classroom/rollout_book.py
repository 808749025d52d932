"""Remembers which roll-outs there were, robot by robot, so that they can be taken back even if they were interrupted.

The terminal and the pages of all masters of this user share it.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Collection
from contextlib import AbstractContextManager, ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import Any

from msbot_agent.process.folder_lock import alone_in
from msbot_agent.process.user_folders import state_folder
from msbot_agent.text.json_reading import read_json
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError

MOST_ROLLOUTS = 20
"""Roll-outs that are remembered; the oldest is forgotten first."""

_in_this_process = threading.Lock()


@dataclass(frozen=True, slots=True)
class RolledOut:
    """A change that a roll-out has made."""

    robot: str
    serial_number: str
    database: str
    """Without a password; of a robot elsewhere, the address of its page."""
    edit: int


@dataclass(frozen=True, slots=True)
class Remembered:
    """A roll-out that was begun."""

    at: float
    """When, seconds since 1970; no two have the same."""
    blueprint: str
    """Where the blueprint is from."""
    done: tuple[RolledOut, ...]
    """What has not been taken back."""


class RollOutBook:
    """See the module's docstring.

    Args:
        folder: where it is kept; None: in the user's state folder.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self._path = (folder or state_folder()) / "rollouts.json"

    def begin(self, blueprint: str) -> float:
        """Begin a roll-out; returns what it is known by, `Remembered.at`."""
        at = time.time()

        def begun(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
            nonlocal at
            at = max([at, *(float(entry["at"]) + 0.001 for entry in entries)])
            return [*entries, {"at": at, "blueprint": blueprint, "done": []}][-MOST_ROLLOUTS:]

        self._change(begun)
        return at

    def note(self, at: float, change: RolledOut) -> None:
        """A robot was changed."""

        def noted(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
            found = [entry for entry in entries if entry["at"] == at]
            if not found:
                raise ConfigError(f"{self._path} does not know this roll-out any more: it cannot be taken back")
            found[0]["done"].append(asdict(change))
            return entries

        self._change(noted)

    def taken_back(self, at: float, changes: Collection[RolledOut]) -> None:
        """These changes of that roll-out are no more."""

        def less(entries: list[dict[str, Any]]) -> list[dict[str, Any]]:
            for entry in entries:
                if entry["at"] == at:
                    entry["done"] = [one for one in entry["done"] if RolledOut(**one) not in changes]
            return entries

        self._change(less)

    def last(self) -> Remembered | None:
        """The latest roll-out of which something was not taken back."""
        for entry in reversed(self._read()):
            if entry["done"]:
                return _remembered(entry)
        return None

    def _change(self, change: Callable[[list[dict[str, Any]]], list[dict[str, Any]]]) -> None:
        with self._alone():
            self._write(change(self._read()))

    def _alone(self) -> AbstractContextManager[object]:
        stack = ExitStack()
        try:
            stack.enter_context(_in_this_process)
            self._path.parent.mkdir(parents=True, exist_ok=True)
            stack.enter_context(alone_in(self._path.parent))
        except OSError as error:
            stack.close()
            raise self._cannot_write(error) from error
        return stack

    def _read(self) -> list[dict[str, Any]]:
        try:
            entries = read_json(self._path.read_text(encoding="utf-8"))
            if not isinstance(entries, list):
                raise TypeError("it is no list")
            for entry in entries:
                _remembered(entry)
        except FileNotFoundError:
            return []
        except (OSError, ValueError, TypeError, KeyError, OverflowError) as error:
            raise ConfigError(f"cannot read which roll-outs there were, {self._path}: {error}; move it away") from error
        return entries

    def _write(self, entries: list[dict[str, Any]]) -> None:
        try:
            new = self._path.with_suffix(".new")
            new.write_text(json.dumps(entries), encoding="utf-8")
            new.replace(self._path)
        except OSError as error:
            raise self._cannot_write(error) from error

    def _cannot_write(self, error: OSError) -> ConfigError:
        return ConfigError(f"cannot write down what was changed, {self._path}: {error.strerror}")


def _remembered(entry: dict[str, Any]) -> Remembered:
    return Remembered(float(entry["at"]), str(entry["blueprint"]), tuple(RolledOut(**one) for one in entry["done"]))

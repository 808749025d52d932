"""Operations as requests from another process: a JSON object in, a JSON object out.

A request is `{"do": name, "args": {...}, "who": name}`; the answer has `words`, and `edit` when something was stored,
or `error`. What may stand in `args` is in `KEYS`; anything else is a mistake that is told.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from pathlib import Path

from msbot.config import load_blueprint, load_library
from msbot.errors import ConfigError, MsbotError
from msbot.operations.live import Operations
from msbot.operations.outcome import Outcome
from msbot.operations.stored import StoredOperations
from msbot.registry import ValueRecord

Answer = dict[str, object]
Someone = Operations | StoredOperations
"""A robot that runs, or one that does not."""

KEYS: Mapping[str, tuple[str, ...]] = {
    "adopt": ("part", "slot"),
    "swap": ("slot", "to"),
    "release": ("slot",),
    "block": ("part", "reason"),
    "unblock": ("part",),
    "set": ("slot", "name", "value"),
    "reset": ("slot", "name"),
    "bind": ("topic", "type", "from", "to", "reliable"),
    "unbind": ("topic", "port"),
    "values": ("slot",),
    "undo": ("edit",),
    "edits": ("limit",),
    "window": ("seconds", "slot"),
    "close_window": (),
    "stop": ("reason",),
    "go": (),
    "stop_report": (),
    "identify": ("part",),
    "why": ("part",),
    "apply": ("path", "folders"),
}
"""Every operation and what it takes."""

MASTER_ONLY = ("window", "close_window", "stop", "go", "stop_report", "identify", "why", "apply")


class Arguments:
    """The arguments of one request.

    Raises:
        ConfigError: there is one that the operation does not know.
    """

    def __init__(self, do: str, values: object) -> None:
        if not isinstance(values, dict):
            raise ConfigError(f"{do}: the arguments must be an object")
        unknown = values.keys() - set(KEYS[do])
        if unknown:
            raise ConfigError(
                f"{do} knows no {', '.join(sorted(unknown))}; it takes {', '.join(KEYS[do]) or 'nothing'}"
            )
        self._do = do
        self._values = values

    def text(self, name: str) -> str:
        """A text that must be there."""
        found = self.optional_text(name)
        if found is None:
            raise ConfigError(f"{self._do}: {name} is missing")
        return found

    def optional_text(self, name: str) -> str | None:
        """A text, or None when it is not there."""
        value = self._values.get(name)
        if value is not None and not isinstance(value, str):
            raise ConfigError(f"{self._do}: {name} must be a text")
        return value

    def texts(self, name: str) -> list[str]:
        """A list of texts; empty when it is not there."""
        value = self._values.get(name, [])
        if not isinstance(value, list) or not all(isinstance(one, str) for one in value):
            raise ConfigError(f"{self._do}: {name} must be a list of texts")
        return value

    def number(self, name: str) -> float:
        """A number."""
        value = self._values.get(name)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ConfigError(f"{self._do}: {name} must be a number")
        return float(value)

    def optional_whole(self, name: str) -> int | None:
        """A whole number, or None when it is not there."""
        value = self._values.get(name)
        if value is not None and (isinstance(value, bool) or not isinstance(value, int)):
            raise ConfigError(f"{self._do}: {name} must be a whole number")
        return value

    def flag(self, name: str, *, default: bool) -> bool:
        """A truth value."""
        value = self._values.get(name, default)
        if not isinstance(value, bool):
            raise ConfigError(f"{self._do}: {name} must be true or false")
        return value


def perform(someone: Someone, request: Mapping[str, object]) -> Answer:
    """Do what a request asks for; a person's mistake is an answer, too."""
    try:
        do, who = request.get("do"), request.get("who")
        if not isinstance(do, str) or do not in KEYS:
            raise ConfigError(f"there is no operation {do!r}; there are {', '.join(KEYS)}")
        if not isinstance(who, str) or not who:
            raise ConfigError(f"{do}: it is not said who asks for it")
        arguments = Arguments(do, request.get("args", {}))
        answer = _of_running(someone, do, arguments, who) if do in MASTER_ONLY else _of_any(someone, do, arguments, who)
    except MsbotError as error:
        return {"error": str(error)}
    if isinstance(answer, Outcome):
        return {"words": answer.words} | ({} if answer.edit_id is None else {"edit": answer.edit_id})
    return answer


def _of_any(someone: Someone, do: str, args: Arguments, who: str) -> Outcome | Answer:
    match do:
        case "adopt":
            return someone.adopt(args.text("part"), args.optional_text("slot"), who=who)
        case "swap":
            return someone.swap(args.text("slot"), args.text("to"), who=who)
        case "release":
            return someone.release(args.text("slot"), who=who)
        case "block":
            return someone.block(args.text("part"), args.optional_text("reason") or "", who=who)
        case "unblock":
            return someone.unblock(args.text("part"), who=who)
        case "set":
            return someone.set_value(args.text("slot"), args.text("name"), args.text("value"), who=who)
        case "reset":
            return someone.reset_value(args.text("slot"), args.text("name"), who=who)
        case "bind":
            source, reliable = args.optional_text("from"), args.flag("reliable", default=True)
            topic, type_name = args.text("topic"), args.text("type")
            return someone.bind(topic, type_name, source, args.texts("to"), reliable=reliable, who=who)
        case "unbind":
            return someone.unbind(args.text("topic"), args.optional_text("port"), who=who)
        case "values":
            return {"values": [_value(value) for value in someone.values(args.text("slot"))]}
        case "undo":
            return someone.undo(args.optional_whole("edit"), who=who)
        case _:
            return {"edits": _edits(someone, args.optional_whole("limit") or 20)}


def _of_running(someone: Someone, do: str, args: Arguments, who: str) -> Outcome | Answer:
    if not isinstance(someone, Operations):
        raise ConfigError(f"{do} needs the robot's master, and it does not run: start it, `msbot master`")
    match do:
        case "window":
            return someone.open_window(args.number("seconds"), args.optional_text("slot"), who=who)
        case "close_window":
            return someone.close_window(who=who)
        case "stop":
            return someone.stop(args.optional_text("reason") or "", who=who)
        case "go":
            return someone.go_on(who=who)
        case "stop_report":
            return _stop_report(someone)
        case "identify":
            return someone.identify(args.text("part"))
        case "why":
            return {"lines": someone.why(args.text("part"))}
        case _:
            return _apply(someone, Path(args.text("path")), [Path(one) for one in args.texts("folders")], who)


def _apply(someone: Operations, path: Path, folders: list[Path], who: str) -> Outcome:
    library = load_library(*folders)
    return someone.apply(load_blueprint(path, library), library=library, who=who)


def _value(value: ValueRecord) -> dict[str, object]:
    return {
        "name": value.name,
        "value": value.value,
        "unit": value.unit,
        "origin": value.origin,
        "who": value.who,
        "least": value.least,
        "most": value.most,
        "description": value.description,
    }


def _edits(someone: Someone, limit: int) -> list[dict[str, object]]:
    return [
        {
            "id": edit.id,
            "at_ns": edit.at_ns,
            "who": edit.who,
            "kind": edit.kind,
            "slot": edit.slot,
            "words": edit.words,
            "undone": edit.undone,
        }
        for edit in someone.edits(limit)
    ]


def _stop_report(someone: Operations) -> Answer:
    report = someone.stop_report
    if report is None:
        return {"holds": False}
    return {
        "holds": True,
        "who": report.who,
        "reason": report.reason,
        "told": report.told,
        "confirmed": report.confirmed,
        "latency_ms": report.latency_ms,
        "age_s": asyncio.get_running_loop().time() - report.at,
    }

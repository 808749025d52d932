"""A part's settings: the parameters of its slot, read with a type, followed while the part runs.

They come as text in the configuration (`Setting`). The registry knows where a value comes from (library, blueprint, by
hand); the part just gets the value in force.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import TypeVar

from msbot.part.handler_guard import Guard
from msbot.part.join.plug import SAFE_MARK, Setting
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

Value = bool | int | float | str
"""What a setting can be."""
V = TypeVar("V", bound=Value)

_TRUTHS = {"true": True, "false": False}
_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


@dataclass(frozen=True, slots=True)
class Follower:
    """A function that is told the value of a setting."""

    read: Callable[[str], Value]
    """Makes a value of the text; on ConfigError the function is not called."""
    function: Callable[..., object]


class Settings:
    """The settings of the present configuration.

    Args:
        guard: calls the followers.
        followers: name of a setting -> who wants to know when it changes; may grow.
        default: the text of a setting that the robot does not set; None: the program gives none.
    """

    def __init__(
        self,
        guard: Guard,
        followers: Mapping[str, Iterable[Follower]],
        default: Callable[[str], str | None] = lambda _: None,
    ) -> None:
        self._guard = guard
        self._followers = followers
        self._default = default
        self._texts: dict[str, str] = {}
        self._told: dict[str, str] = {}

    @property
    def texts(self) -> Mapping[str, str]:
        """The settings by name, as text."""
        return MappingProxyType(self._texts)

    def value(self, name: str, kind: type[V], default: V | None = None) -> V:
        """The value of a setting; the default when this robot does not set it.

        Raises:
            ConfigError: it is not set and there is no default, or its text is not of that kind.
        """
        check_kind(name, kind)
        text = self._texts.get(name)
        if text is not None:
            return read_value(name, text, kind)
        if default is not None:
            return default
        known = ", ".join(sorted(self._texts)) or "none"
        raise ConfigError(f"there is no setting {name!r} in this robot; it sets: {known}")

    def take(self, settings: Iterable[Setting]) -> dict[str, str]:
        """Make these the settings; returns the safe values among them, by their full names."""
        everything = {setting.name: setting.value for setting in settings}
        safe = {name: text for name, text in everything.items() if SAFE_MARK in name}
        self._texts = {name: text for name, text in everything.items() if name not in safe}
        return safe

    def forget(self) -> None:
        """Forget all settings, and who was told of them."""
        self._texts, self._told = {}, {}

    def tell(self) -> None:
        """Call the functions whose setting has changed since they were last called."""
        told, self._told = self._told, {}
        for name, followers in self._followers.items():
            text = self._texts.get(name, self._default(name))
            if text is not None:
                self._told[name] = text
            if text is None:
                self._guard.report(f"setting {name!r}", "this robot does not set it", kind="absent")
            elif told.get(name) != text:
                for follower in followers:
                    self._tell(name, text, follower)

    def _tell(self, name: str, text: str, follower: Follower) -> None:
        try:
            value = follower.read(text)
        except ConfigError as error:
            self._guard.report(f"setting {name!r}", str(error))
            return
        self._guard.call(follower.function, value)


def check_kind(name: str, kind: object) -> None:
    """Refuse a kind that no setting can have.

    Raises:
        ConfigError: it is not bool, int, float or str.
    """
    if kind not in _WORDS:
        raise ConfigError(f"setting {name!r} can be read as bool, int, float or str, not as {kind!r}")


def read_value(name: str, text: str, kind: type[V]) -> V:
    """The text of a setting as a value of that kind.

    Raises:
        ConfigError: it is not of that kind.
    """
    try:
        return kind(_TRUTHS[text] if kind is bool else text)
    except (ValueError, KeyError):
        raise ConfigError(f"setting {name!r} is {text!r}, which is not {_WORDS[kind]}") from None


# What is counted of a part while it runs.


@dataclass(slots=True)
class PartCounters:
    """Counts of what happened to a part since it began to run."""

    messages_in: int = 0
    """Samples handed to a handler."""
    messages_out: int = 0
    """Samples published."""
    not_sent: int = 0
    """Samples not sent because the stream or the link had no room."""
    dropped: int = 0
    """Samples that arrived and could not be used."""
    refused: int = 0
    """Samples without a good seal, in a robot with `authentication = "key+data"`."""
    held: int = 0
    """Samples that arrived after STOP and were not used."""
    beats: int = 0
    """Beats that the inventory answered."""
    missed_beats: int = 0
    handler_errors: int = 0

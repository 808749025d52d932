"""A part's settings: what its program declares of them, and the parameters of its slot, read with a type.

They come as text in the configuration (`Setting`). The registry knows where a value comes from (library, blueprint, by
hand); the part just gets the value in force. `Membership` receives a configuration, `ProgramRunner` passes its settings
on to `Settings`, and that calls the program's functions whose setting has changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from types import MappingProxyType
from typing import TypeVar

from msbot.part.handler_guard import Guard, check_handler
from msbot.part.join.pnp_messages import RANGE_MARK, SAFE_MARK, Setting
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

Value = bool | int | float | str
"""What a setting can be."""
V = TypeVar("V", bound=Value)

_TRUTHS = {"true": True, "false": False}
_WORDS = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


@dataclass(frozen=True, slots=True)
class DeclaredSetting:
    """A setting with its default and its range, as the program declares it."""

    kind: type[Value]
    default: Value
    least: float | None = None
    most: float | None = None
    unit: str = ""

    @property
    def default_text(self) -> str:
        """The default as a setting's text."""
        return str(self.default).lower() if isinstance(self.default, bool) else str(self.default)


@dataclass(frozen=True, slots=True)
class SettingListener:
    """A function that is told the value of a setting."""

    read: Callable[[str], Value]
    """Makes a value of the text; on ConfigError the function is not called."""
    function: Callable[..., object]


class DeclaredSettings:
    """What a program says of its settings; read even while it grows."""

    def __init__(self) -> None:
        self.declared: dict[str, DeclaredSetting] = {}
        """Setting -> its default and range; only those that the program declares."""
        self.followers: dict[str, list[SettingListener]] = {}
        """Setting -> who is told of its changes."""
        self.read: set[str] = set()
        """The settings that `part.setting` has been asked for."""

    def declare(self, name: str, setting: DeclaredSetting) -> None:
        """The part has that setting.

        Raises:
            ConfigError: no setting can be so, or it is declared in another way already.
        """
        check_kind(name, setting.kind)
        given = type(setting.default)
        if given is not setting.kind and (given, setting.kind) != (int, float):
            raise ConfigError(
                f"setting {name!r} is {setting.kind.__name__}, and its default {setting.default!r} is not"
            )
        if self.declared.setdefault(name, setting) != setting:
            raise ConfigError(f"setting {name!r} is declared twice, in different ways: declare it once")

    def follow(
        self,
        name: str,
        kind: type[V],
        function: Callable[[V], object],
        setting: DeclaredSetting | None = None,
        *,
        check: Callable[[V], None] = lambda _: None,
    ) -> None:
        """Call the function with the value of a setting.

        Args:
            name: the setting.
            kind: what its text is read as.
            function: what is called, before `on_join` and at each change.
            setting: declares it.
            check: raises ConfigError for a value with which the function is not called.

        Raises:
            ConfigError: the function cannot be called with it, or the setting cannot be declared so.
        """
        check_handler(function, "value")
        check_kind(name, kind)
        if setting is not None:
            self.declare(name, setting)

        def read(text: str) -> V:
            value = read_value(name, text, kind)
            check(value)
            return value

        self.followers.setdefault(name, []).append(SettingListener(read, function))


class Settings:
    """The settings of the present configuration.

    Args:
        guard: calls the followers.
        program: whom to tell of which setting, and the values of those that the robot does not set.
    """

    def __init__(self, guard: Guard, program: DeclaredSettings) -> None:
        self._guard = guard
        self._program = program
        self.ranges: dict[str, str] = {}
        """The ranges of what the part publishes, by their full names."""
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
        self._program.read.add(name)
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
        self.ranges = {name: text for name, text in everything.items() if RANGE_MARK in name}
        self._texts = {name: text for name, text in everything.items() if name not in safe and name not in self.ranges}
        return safe

    def forget(self) -> None:
        """Forget all settings, and who was told of them."""
        self._texts, self._told = {}, {}

    def tell(self) -> None:
        """Call the functions whose setting has changed since they were last called."""
        told, self._told = self._told, {}
        for name, followers in self._program.followers.items():
            declared = self._program.declared.get(name)
            text = self._texts.get(name, None if declared is None else declared.default_text)
            if text is not None:
                self._told[name] = text
            if text is None:
                self._guard.report(f"setting {name!r}", "this robot does not set it", kind="absent")
            elif told.get(name) != text:
                for follower in followers:
                    self._tell(name, text, follower)

    def _tell(self, name: str, text: str, follower: SettingListener) -> None:
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

"""The console of a simulated part: prints what changes, and takes what a person types, `control=value`."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
from collections.abc import Callable, Iterable, Mapping
from typing import TextIO

from msbot.config import Reading, Scalar, scalar_text
from msbot.sim import SimulatedPart
from msbot_xrce.errors import ConfigError

LOOK_S = 0.2
"""Period in which readings are checked for changes."""
MOST_TYPED = 4096
"""Most octets read from the terminal at once, and most characters of a line."""
SHARE = 0.02
SIGMAS = 8
"""A number is printed again when it has changed by more than a share of itself and by this multiple of its noise;
without noise also when it comes to rest at a value other than the one printed: the last small step of a ramp."""


class PartConsole:
    """Watches one simulated part.

    Args:
        simulated: the part.
        say: prints a line.
        source: where typed lines come from; None = nobody types.
    """

    def __init__(self, simulated: SimulatedPart, say: Callable[[str], None], source: TextIO | None = None) -> None:
        self._simulated = simulated
        self._say = say
        self._source = source
        self._listening = False
        self._unfinished = ""
        self._said: dict[str, Scalar] = {}
        self._seen: dict[str, Scalar] = {}
        """The readings at the last look."""
        spec = simulated.part_type.simulator
        self._readings: dict[str, Reading] = {} if spec is None else {entry.name: entry for entry in spec.readings}
        part = simulated.part
        part.on_join(self._listen)
        part.on_lost(self.look)
        part.every(LOOK_S)(self.look)

    def look(self) -> None:
        """Print which readings have changed."""
        readings = self._simulated.readings()
        changed = {name: value for name, value in readings.items() if self._is_news(name, value)}
        self._seen = dict(readings)
        if changed:
            self._said |= changed
            self._say(", ".join(self._words(name, value) for name, value in changed.items()))

    def typed(self, line: str) -> None:
        """Do what a person typed; invalid input is answered with a sentence."""
        if not line.strip():
            return
        try:
            apply_settings(self._simulated, [line.strip()])
        except ConfigError as error:
            self._say(str(error))
        self.look()

    def _is_news(self, name: str, value: Scalar) -> bool:
        before = self._said.get(name)
        if isinstance(value, float) and isinstance(before, float):
            noise = self._readings[name].noise
            least = 0.0 if isinstance(noise, str) else SIGMAS * noise
            if least == 0.0 and value == self._seen.get(name):
                return self._words(name, value) != self._words(name, before)
            return abs(value - before) > max(least, SHARE * max(abs(value), abs(before)))
        return value != before

    def _words(self, name: str, value: Scalar) -> str:
        unit = self._readings[name].unit
        text = f"{value:.4g}" if isinstance(value, float) else scalar_text(value)
        return f"{name} {text} {unit}".rstrip()

    def _listen(self) -> None:
        if self._listening or self._source is None or not _is_ours(self._source):
            return
        self._listening = True
        # A file that is not a terminal or pipe, or a loop that cannot watch one: then nobody types.
        with contextlib.suppress(OSError, ValueError, NotImplementedError):
            asyncio.get_running_loop().add_reader(self._source, self._hear)

    def _hear(self) -> None:
        assert self._source is not None
        if not _is_ours(self._source):
            asyncio.get_running_loop().remove_reader(self._source)
            return
        # Not readline: what it reads ahead would wait for the next time something is typed.
        typed = os.read(self._source.fileno(), MOST_TYPED).decode(errors="replace")
        if not typed:
            asyncio.get_running_loop().remove_reader(self._source)
        self.take(typed)

    def take(self, typed: str) -> None:
        """Do what each line says that is whole now."""
        *lines, self._unfinished = (self._unfinished + typed).split("\n")
        for line in lines:
            if len(line) > MOST_TYPED:
                self._say(f"a line of more than {MOST_TYPED} characters is left out: write CONTROL=VALUE")
            else:
                self.typed(line)
        self._unfinished = self._unfinished[: MOST_TYPED + 1]  # too long already, whatever follows


def _is_ours(source: TextIO) -> bool:
    """Whether this program may read: one in the background that reads from its terminal would be stopped."""
    if sys.platform == "win32" or not source.isatty():
        return True
    try:
        return os.tcgetpgrp(source.fileno()) == os.getpgrp()
    except OSError:
        return True  # a terminal, but not the one this program was started from, so reading does not stop it


def apply_settings(simulated: SimulatedPart, settings: Iterable[str]) -> None:
    """Set controls from texts such as `press=true`.

    Raises:
        ConfigError: a text has no equals sign, there is no such control, or it cannot have that value.
    """
    for text in settings:
        name, sign, value = text.partition("=")
        if not sign:
            raise ConfigError(f"{text!r} sets nothing: write CONTROL=VALUE; {controls_words(simulated)}")
        control = simulated.control(name.strip())
        simulated.set(control.name, control.parse(value.strip()))


def controls_words(simulated: SimulatedPart) -> str:
    """The controls that can be set, in a sentence."""
    from msbot.cli.library.view import control_values

    known: Mapping[str, str] = {control.name: control_values(control) for control in simulated.controls}
    listed = "; ".join(f"{name} ({values})" for name, values in known.items())
    return f"controls: {listed}" if listed else "this part has no controls"

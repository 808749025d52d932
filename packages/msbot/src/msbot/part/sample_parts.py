"""The three parts of the thesis' sample robot: AA -> BB -> CC -> AA (thesis 4.3.3).

Each says something once a second at its port `out` and listens at its port `in`. AA's "turn-on N" switches output N
of BB's GPIO board and switches the one before it off.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from random import Random

from msbot.part.boards.gpio import PINS, PinDirection, SimGpio, UsbGpio
from msbot.part.messages.standard import HelloWorld
from msbot.part.part import Part
from msbot_xrce.errors import ConfigError
from msbot_xrce.lazy import dataclass

ROBOT = "MSBOT_MASTER"
"""The robot they are made for (thesis 3.12.1)."""
PERIOD_S = 1.0
PIN_PLACE = 23
"""Index of the character in AA's text that is the number of the output (the thesis' program of BB)."""
WATCHED_PIN = 3
"""The pin whose level BB reports."""

_log = logging.getLogger("msbot.part")


@dataclass(frozen=True, slots=True)
class SamplePart:
    """One of the three."""

    part_number: str
    play: Callable[[Part, Random], None]
    """Gives a part its functions; the random generator decides what it says."""
    says: str
    """One of the texts that it publishes; they are all of this length."""


def make_sample(
    name: str,
    *,
    uid: bytes | None = None,
    random: Random | None = None,
    board: UsbGpio | None = None,
    local_name: str = "",
) -> Part:
    """One of the sample parts, ready to run.

    Args:
        name: AA, BB or CC.
        uid: 8 octets; if absent, `run` draws or keeps one.
        random: decides what AA and CC say, and the part's client key.
        board: BB's GPIO board; a simulated one if absent.
        local_name: what this part is called; the name in the thesis if absent.

    Raises:
        ConfigError: there is no such part.
    """
    if name not in SAMPLE_PARTS:
        raise ConfigError(f"there is no sample part {name!r}: choose {', '.join(SAMPLE_PARTS)}")
    sample = SAMPLE_PARTS[name]
    dice = random or Random()
    part = Part(
        sample.part_number,
        local_name=local_name or f"{sample.part_number}-local",
        robot=ROBOT,
        uid=uid,
        random=dice,
        board=board or (SimGpio() if name == "BB" else None),
    )
    sample.play(part, dice)
    return part


def pin_in(text: str) -> int | None:
    """The number of the output that AA's text names, or None."""
    digit = text[PIN_PLACE : PIN_PLACE + 1]
    return int(digit) if digit in tuple("01234567") else None


def _light_sensor(part: Part, random: Random) -> None:
    count = _Count()

    @part.every(PERIOD_S)
    def tell() -> None:
        part.publish("out", HelloWorld(index=count.next(), message=f"Publisher A(1) turn-on {random.randrange(PINS)}"))

    _note_what_comes(part)


def _toggle_switch(part: Part, random: Random) -> None:  # noqa: ARG001 - one signature for all three
    count = _Count()

    @part.on_join
    def begin() -> None:
        for pin in range(PINS):
            part.board.set_direction(pin, PinDirection.OUTPUT)

    @part.safe_state
    def all_off() -> None:
        for pin in range(PINS):
            part.board.set_direction(pin, PinDirection.OUTPUT)  # STOP also reaches parts that were never active
            part.board.clear(pin)

    @part.on("in", HelloWorld)
    def switch(message: HelloWorld) -> None:
        wanted = pin_in(message.message)
        if wanted is None:
            return
        for pin in range(PINS):
            if pin != wanted:
                part.board.clear(pin)
        part.board.set(wanted)

    @part.every(PERIOD_S)
    def tell() -> None:
        level = int(part.board.read(WATCHED_PIN))
        part.publish("out", HelloWorld(index=count.next(), message=f"Publisher B(2) gpio-{WATCHED_PIN} = {level}"))


def _motor_driver(part: Part, random: Random) -> None:
    count = _Count()

    @part.every(PERIOD_S)
    def tell() -> None:
        # "C(1)" is how the thesis' program writes it.
        value = random.randrange(PINS)
        part.publish("out", HelloWorld(index=count.next(), message=f"Publisher C(1) random value = {value}"))

    _note_what_comes(part)


def _note_what_comes(part: Part) -> None:
    @part.on("in", HelloWorld)
    def tell(message: HelloWorld) -> None:
        _log.debug("%s hears: %s", part.local_name, message.message)


class _Count:
    """The index of the next message; wraps as the uint32 that it is."""

    def __init__(self) -> None:
        self._count = 0

    def next(self) -> int:
        self._count = self._count % 0xFFFFFFFF + 1
        return self._count


SAMPLE_PARTS = {
    "AA": SamplePart("ABCD", _light_sensor, "Publisher A(1) turn-on 3"),
    "BB": SamplePart("EFGH", _toggle_switch, "Publisher B(2) gpio-3 = 0"),
    "CC": SamplePart("WXYZ", _motor_driver, "Publisher C(1) random value = 3"),
}
"""The parts of the sample robot by the names of their slots."""

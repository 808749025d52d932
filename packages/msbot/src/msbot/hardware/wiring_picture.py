"""Draws how a part type is wired: its connector on the left, where each pin goes on the right, a wire between."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from html import escape as escape_html

from msbot.config import BusKind, PartType, Pin
from msbot_agent.text.sentence import said

escape = partial(escape_html, quote=False)  # all of it stands between tags

ROW, TOP, WIDTH = 40, 56, 820
PART_RIGHT, PLACE_LEFT = 200, 340
COLOURS = {"power": "#c62828", "ground": "#37474f", "signal": "#00695c", "bus": "#1565c0"}
"""Of the wires, by what they carry."""


def wiring_picture(
    part_type: PartType,
    at: Mapping[str, int | str] | None = None,
    computer: str = said("Raspberry Pi or another Linux board"),
    say: Callable[[str], str] = str,
) -> str:
    """The picture as SVG; readable on a light and on a dark page.

    Args:
        part_type: what is wired.
        at: the pins of a board with MicroPython, by wire; None: the default pins of a Linux board.
        computer: what it is wired to.
        say: gives a text in the reader's language.
    """
    pins = part_type.pins
    height = TOP + ROW * len(pins) + 16
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" height="{height}" '
        f'font-family="sans-serif" font-size="14" role="img">',
        f"<title>{escape(f'{part_type.number}: {say(part_type.name)}')}</title>",
        f'<rect width="{WIDTH}" height="{height}" rx="8" fill="#ffffff"/>',
        f'<text x="20" y="30" font-size="16" font-weight="bold" fill="#0b1f33">{escape(part_type.number)}</text>',
        f'<text x="{PLACE_LEFT + 12}" y="30" fill="#455a64">{escape(say(computer))}</text>',
        f'<rect x="20" y="42" width="{PART_RIGHT - 20}" height="{height - 54}" rx="6" '
        'fill="#e3f2fd" stroke="#0b1f33"/>',
    ]
    for row, pin in enumerate(pins):
        lines += _row(part_type, pin, TOP + ROW * row + ROW // 2, at, say)
    return "\n".join([*lines, "</svg>"]) + "\n"


def _row(
    part_type: PartType, pin: Pin, y: int, at: Mapping[str, int | str] | None, say: Callable[[str], str]
) -> list[str]:
    goes = place_of(part_type, pin) if at is None else place_at_board(part_type, pin, at)
    lines = [
        f'<text x="{PART_RIGHT - 14}" y="{y + 5}" text-anchor="end" fill="#0b1f33">{escape(pin.name)}</text>',
        f'<circle cx="{PART_RIGHT}" cy="{y}" r="5" fill="{COLOURS.get(pin.kind.value, "#b0bec5")}"/>',
    ]
    if not goes:
        return [*lines, f'<text x="{PART_RIGHT + 14}" y="{y + 5}" fill="#78909c">{say(said("not connected"))}</text>']
    colour = COLOURS.get(pin.kind.value, "#607d8b")
    wire = next((one for one in part_type.driver.pins if one.pin == pin.name), None)
    between: list[str] = []
    if wire is not None and wire.description:
        middle = (PART_RIGHT + PLACE_LEFT) // 2
        if wire.description.startswith("through"):  # not a plain wire
            between.append(
                f'<rect x="{middle - 16}" y="{y - 7}" width="32" height="14" fill="#fff" stroke="{colour}"/>'
            )
        note = escape(say(wire.description))
        between.append(f'<text x="{PLACE_LEFT + 12}" y="{y + 19}" font-size="11" fill="#b71c1c">{note}</text>')
    return [
        *lines,
        f'<line x1="{PART_RIGHT}" y1="{y}" x2="{PLACE_LEFT}" y2="{y}" stroke="{colour}" stroke-width="3"/>',
        f'<circle cx="{PLACE_LEFT}" cy="{y}" r="5" fill="{colour}"/>',
        f'<text x="{PLACE_LEFT + 12}" y="{y + 5}" fill="#0b1f33">{escape(say(goes))}</text>',
        *between,
    ]


def place_of(part_type: PartType, pin: Pin) -> str:
    """Where a pin goes by default; "" = nowhere."""
    driver = part_type.driver
    wire = next((one for one in driver.pins if one.pin == pin.name), None)
    if pin.kind.value in ("ground", "power"):
        return _supply_of(part_type, pin)
    if wire is not None:
        place = said("channel") if wire.analog else "GPIO"
        return (
            said("{wire}, on a pin that you choose", wire=wire.name)
            if wire.default is None
            else said("{place} {number} ({wire})", place=place, number=wire.default, wire=wire.name)
        )
    if driver.bus is BusKind.I2C:
        return {"SDA": "SDA, GPIO 2", "SCL": "SCL, GPIO 3"}.get(pin.name, "")
    if driver.bus is BusKind.SPI and pin.name == "DIN":
        return "MOSI, GPIO 10"
    if driver.bus is BusKind.KERNEL and pin.name == "DATA":
        return "GPIO 4"
    return ""


def place_at_board(part_type: PartType, pin: Pin, at: Mapping[str, int | str]) -> str:
    """Where a pin goes at a board with MicroPython; "" = nowhere."""
    wire = next((name for name, own in part_type.driver.board.pins.items() if own == pin.name), None)
    if wire is None:
        return _supply_of(part_type, pin) if pin.kind.value in ("ground", "power") else ""
    return said("pin {number} ({wire})", number=at[wire], wire=wire) if wire in at else ""


def _supply_of(part_type: PartType, pin: Pin) -> str:
    if pin.kind.value == "ground":
        return said("ground")
    supply = part_type.supply
    if supply is None:
        return said("supply")
    if supply.min_v == supply.max_v:
        return said("supply, {volts:g} V", volts=supply.min_v)
    return said("supply, {least:g} to {most:g} V", least=supply.min_v, most=supply.max_v)

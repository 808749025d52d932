"""The lines of config.txt that belong to the card's settings; all others are left as they are. Pure."""

from __future__ import annotations

from msbot_card.settings import CAN_HATS, Settings

I2C = {"pi3": "msbot-i2c", "pi4": "msbot-i2c", "pi5": "msbot-i2c-pi5"}
"""The overlay of each board, by its filter in config.txt."""
BEGIN, END = "# MsBOT: begin (made by the page, see Admin)", "# MsBOT: end"


def lines_of(settings: Settings) -> list[str]:
    """What the settings need of the firmware."""
    lines = []
    for board, overlay in I2C.items() if settings.i2c else ():
        lines += [f"[{board}]", f"dtoverlay={overlay}"]
    lines.append("[all]")
    if hat := CAN_HATS[settings.can]:
        lines.append(f"dtoverlay={hat}")
    return lines if len(lines) > 1 else []


def edited(text: str, settings: Settings) -> str:
    """The file with the settings' lines in place of those that are there."""
    kept, inside = [], False
    for line in text.splitlines():
        if line.strip() == BEGIN:
            inside = True
        elif line.strip() == END and inside:
            inside = False
        elif not inside:
            kept.append(line)
    if inside:  # somebody took the second mark out; nothing behind the first one is lost but our own lines
        behind = text.splitlines()[len(kept) + 1 :]
        kept += [line for line in behind if "=msbot-" not in line]
    while kept and not kept[-1].strip():
        kept.pop()
    wanted = lines_of(settings)
    if wanted:
        kept += ["", BEGIN, *wanted, END]
    return "\n".join(kept) + "\n"

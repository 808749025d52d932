"""Writes what docs/reference/hardware.md and docs/reference/wiring.md say of the part types, from their files, with a
picture of the wires of each.

    python tools/hardware_table.py           writes both
    python tools/hardware_table.py --check   says whether they are up to date (status 1 if not); a test does the same
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

from msbot.config import BOARD_DRIVERS, BusKind, PartType, load_library, scalar_text
from msbot.hardware.wiring_picture import wiring_picture

ROOT = Path(__file__).parents[1]
REFERENCE = ROOT / "docs/reference/hardware.md"
WIRING = ROOT / "docs/reference/wiring.md"
PICTURES = ROOT / "docs/reference/wiring"
BEGIN = "<!-- made by tools/hardware_table.py -->\n"
BEGIN_BOARDS = "<!-- the drivers of boards; made by tools/hardware_table.py -->\n"
END = "<!-- end of what is made -->\n"
SAID_ONCE = ("pull", "active_low", "frequency_hz", "full_v", "min_pulse_ms", "max_pulse_ms")
"""Options that the page's head explains."""
TESTS = ("packages/msbot/tests/hardware", "tests/socketcan")
"""Folders of the tests of drivers."""


def tests_of(part_type: PartType) -> list[str]:
    """The files of tests that name a part type."""
    return [
        path.name
        for folder in TESTS
        for path in sorted((ROOT / folder).glob("test_*.py"))
        if re.search(rf"[\"']{re.escape(part_type.number)}[\"']", path.read_text("utf-8"))
    ]


def table() -> str:
    """One line for each part type without a driver."""
    part_types = sorted(load_library(), key=lambda one: one.number)
    rows = [f"* `{one.number}`: {one.driver.none}" for one in part_types if not one.driver.entry_point]
    return "\n".join(rows) + "\n"


def drivers_of_boards() -> str:
    """One line for each driver of boards."""
    rows = [f"* `{name}` ({driver.words}): {', '.join(driver.sources)}" for name, driver in BOARD_DRIVERS.items()]
    return "\n".join(rows) + "\n"


def wiring() -> str:
    """One section for each part type with a driver. The page's head says what holds for all of them."""
    sections = []
    for part_type in sorted(load_library(), key=lambda one: one.number):
        driver = part_type.driver
        if not driver.entry_point:
            continue
        words = _supply(part_type)
        supply = f" ({words})" if any(pin.name == "VCC" and pin.kind.value == "power" for pin in part_type.pins) else ""
        lines = [f"## {part_type.number}", "", f"{part_type.name}{supply}. `{example(part_type)}`{options(part_type)}"]
        lines += ["", f"![{part_type.number}](wiring/{part_type.number}.svg)"]
        sections.append("\n".join(lines) + "\n")
    return "\n".join(sections)


def _supply(part_type: PartType) -> str:
    return str(part_type.supply or "supply").replace("at most ", "")


def options(part_type: PartType) -> str:
    """The options with their defaults."""
    said = []
    for option in part_type.driver.options:
        unit = f" {option.unit}" if option.unit else ""
        words = "" if option.name in SAID_ONCE else f" ({option.description})"
        said.append(f"`{option.name}={scalar_text(option.default)}`{unit}{words}")
    return f". Options: {', '.join(said)}" if said else ""


def example(part_type: PartType) -> str:
    """The command that runs it, with its usual wires."""
    driver = part_type.driver
    digital = ",".join(f"{pin.name}={pin.default}" for pin in driver.pins if not pin.analog)
    analog = ",".join(f"{pin.name}={pin.default}" for pin in driver.pins if pin.analog)
    words = f"msbot part {part_type.number}"
    words += f" --pins {digital}" if digital else ""
    words += f" --adc {analog}" if analog else ""
    words += f" --i2c 1:0x{driver.addresses[0]:02x}" if driver.bus is BusKind.I2C else ""
    words += f" --device {driver.device}" if driver.device else ""
    return words if words != f"msbot part {part_type.number}" else f"{words} --real"


def pages() -> dict[Path, str]:
    """Both pages as they should be."""
    made = ((REFERENCE, BEGIN, table()), (REFERENCE, BEGIN_BOARDS, drivers_of_boards()), (WIRING, BEGIN, wiring()))
    found = {path: path.read_text("utf-8") for path in (REFERENCE, WIRING)}
    for path, begin, text in made:
        before, _, rest = found[path].partition(begin)
        found[path] = f"{before}{begin}{text}{END}{rest.partition(END)[2]}"
    for part_type in load_library():
        if part_type.driver.entry_point:
            found[PICTURES / f"{part_type.number}.svg"] = wiring_picture(part_type)
    return found


def main() -> None:
    """Write the pages, or check them."""
    wrong = [path for path, text in pages().items() if not path.exists() or path.read_text("utf-8") != text]
    if "--check" in sys.argv[1:]:
        for path in wrong:
            print(f"{path.relative_to(ROOT)} is not up to date: run `python tools/hardware_table.py`")  # noqa: T201
        sys.exit(bool(wrong))
    PICTURES.mkdir(exist_ok=True)
    for path, text in pages().items():
        path.write_text(text, "utf-8")


if __name__ == "__main__":
    main()

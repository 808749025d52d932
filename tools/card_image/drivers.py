"""Which drivers the initramfs needs: those that the device trees of the boards name, as far as they lead to the root.

Debian's initramfs for any computer has ten times as many, and takes the firmware seconds to read.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path

from tools.card_image.base import run

SUBSYSTEMS = (
    "char/hw_random", "clk", "dma", "firmware", "gpio", "hwspinlock", "mailbox", "mfd", "misc", "mmc", "mux", "nvmem",
    "pci", "phy", "pinctrl", "pmdomain", "power", "regulator", "reset", "soc", "usb",
)  # fmt: skip
"""Folders of the kernel's drivers on the way to a card or a USB stick."""
_ALIAS = re.compile(r"^alias of:N\S*?T\S*?C(\S+?)(?:C\*)? (\S+)$", re.MULTILINE)


def compatibles(sources: Iterable[str]) -> set[str]:
    """What device trees, as text, say of their devices."""
    found = set()
    for source in sources:
        for values in re.findall(r'compatible = ("[^;]*");', source):
            for value in re.findall(r'"([^"]+)"', values):
                found.update(value.split("\\0"))  # as dtc of Debian 12 writes several
    return found


def drivers(aliases: str, places: str, wanted: set[str]) -> list[str]:
    """The modules for these devices.

    Args:
        aliases: the kernel's `modules.alias`.
        places: its `modules.dep`, which says where each module is.
        wanted: what device trees say of their devices.
    """
    usable = set()
    for line in places.splitlines():
        path = line.partition(":")[0]
        if path.startswith(tuple(f"kernel/drivers/{folder}/" for folder in SUBSYSTEMS)):
            usable.add(path.rsplit("/", 1)[-1].partition(".")[0].replace("-", "_"))
    named = {module.replace("-", "_") for device, module in _ALIAS.findall(aliases) if device in wanted}
    return sorted(named & usable)


def of_boards(trees: Iterable[Path], modules: Path) -> list[str]:
    """The modules that these boards need.

    Args:
        trees: their device trees.
        modules: the kernel's folder of modules.
    """
    sources = [run("dtc", "-q", "-I", "dtb", "-O", "dts", tree) for tree in trees]
    aliases, places = ((modules / name).read_text("utf-8") for name in ("modules.alias", "modules.dep"))
    return drivers(aliases, places, compatibles(sources))

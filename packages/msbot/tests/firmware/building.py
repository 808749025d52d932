"""Compiles the firmware for this computer and for Cortex-M; says why when it cannot."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from tests import ROOT
from tests.kept import kept, said_once

SOURCES = ROOT / "firmware" / "c"
WARNINGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wshadow", "-pedantic")
SANITIZERS = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def need(*tools: str) -> None:
    """Skip the test where a tool, or what belongs to it, is missing; fail where nothing may be skipped (CI says so)."""
    missing = [tool for tool in tools if not _is_there(tool)]
    if missing and os.environ.get("MSBOT_NEED_FIRMWARE"):
        pytest.fail(f"not installed: {', '.join(missing)}")
    if missing:
        pytest.skip(f"needs {', '.join(missing)} (Debian: see .ci/run)")


def _is_there(tool: str) -> bool:
    if shutil.which(tool) is None:
        return False
    if tool == "arm-none-eabi-gcc":
        return Path(run(tool, "-print-file-name=nano.specs").strip()).is_absolute()
    if tool == "clang":
        return any(Path(run(tool, "-print-runtime-dir").strip()).glob("libclang_rt.fuzzer*"))
    return True


def run(*command: str | Path, timeout_s: float = 120.0) -> str:
    """Run a command; fails with all it said when it does not end well."""
    result = subprocess.run(
        [str(word) for word in command],
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
        cwd=ROOT,
    )
    assert result.returncode == 0, f"{' '.join(map(str, command))}\n{result.stdout}{result.stderr}"
    return result.stdout + result.stderr


def compiled(name: str, *command: str | Path) -> Path:
    """The program that a compiler makes of the firmware: told everything but where to put it."""

    def make(folder: Path) -> None:
        run(*command, "-o", folder / name)

    return kept(f"firmware-{name}", make, tools=(str(command[0]),), told=command, of=SOURCES) / name


def judged(name: str, ask: Callable[[], str], *told: object, tools: Sequence[str]) -> str:
    """What a checker says of the firmware, which has to content it: asked again only when something has changed."""
    return said_once(f"firmware-{name}", ask, tools=tools, told=told, of=SOURCES)


def pipe_program() -> Path:
    """The firmware on a pipe (`host/pipe.c`), with the sanitizers."""
    modules = [*sorted(SOURCES.glob("msbot_*.c")), SOURCES / "host" / "pipe.c"]
    return compiled("pipe", "gcc", *WARNINGS, *SANITIZERS, "-DMSBOT_CAN_DATA=64", "-I", SOURCES, *modules)


def linux_board() -> Path:
    """The example for Linux: a board that is a process."""
    examples = SOURCES / "examples"
    main = (examples / "pin_board.c", examples / "linux_socketcan" / "main.c")
    return compiled("board", "gcc", *WARNINGS, "-O2", "-I", SOURCES, *sorted(SOURCES.glob("msbot_*.c")), *main)


CORTEX_M4 = ("-mcpu=cortex-m4", "-mthumb", "-Os", "-ffunction-sections", "-fdata-sections")


LINK = ("-nostartfiles", "--specs=nano.specs", "-Wl,--gc-sections", "-T", str(SOURCES / "examples" / "memory.ld"))
EMULATED = "stm32f405_qemu"
DRIVERS = {EMULATED: "slcan.c", "stm32f4_bxcan": "bxcan.c", "stm32g4_fdcan": "fdcan.c"}
"""The examples with their CAN controllers."""
FOR_EXAMPLE = {"stm32g4_fdcan": ("-DMSBOT_CAN_DATA=64", "-Wl,--defsym=ram_size=0x8000")}


def link_example(example: str) -> Path:
    """An example as an ELF file for its microcontroller."""
    examples = SOURCES / "examples"
    modules = sorted(SOURCES.glob("msbot_*.c"))
    more = (examples / "pin_board.c", examples / DRIVERS[example], examples / example / "main.c")
    options = (*CORTEX_M4, *WARNINGS, *LINK, *FOR_EXAMPLE.get(example, ()))
    return compiled(f"{example}.elf", "arm-none-eabi-gcc", *options, "-I", SOURCES, *modules, *more)

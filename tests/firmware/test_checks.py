"""The C code under the compilers' and checkers' eyes, its size, its examples, and a fuzzer."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.firmware.building import CORTEX_M4, SANITIZERS, SOURCES, WARNINGS, link_example, need, run

MODULES = sorted(SOURCES.glob("msbot_*.c"))
EXAMPLES = sorted((SOURCES / "examples").glob("*.c"))
INCLUDE = ("-I", str(SOURCES))
SEAMS = tuple(
    word for seam in ("freertos", "micro_xrce_dds", "zephyr") for word in ("-I", str(SOURCES / "examples/seams" / seam))
)
"""Declarations in place of the libraries that the examples are for."""
FUZZ_RUNS = 5_000


def each(paths: list[Path], *command: str, last: tuple[str, ...] = ()) -> None:
    """Run a command for each file, two at a time."""
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda path: run(*command, path, *last), paths))


def test_it_is_clean_c99_for_gcc_and_its_analyzer(tmp_path: Path) -> None:
    need("gcc")
    each(MODULES, "gcc", *WARNINGS, "-O2", "-fanalyzer", *INCLUDE, "-c", "-o", "/dev/null")
    assert not any("malloc" in path.read_text() for path in MODULES)


@pytest.mark.parametrize("core", ["cortex-m0", "cortex-m4"])
def test_it_is_clean_for_a_microcontroller(core: str) -> None:
    need("arm-none-eabi-gcc")
    each(
        [*MODULES, *EXAMPLES],
        *(
            "arm-none-eabi-gcc",
            f"-mcpu={core}",
            *CORTEX_M4[1:],
            *WARNINGS,
            *INCLUDE,
            *SEAMS,
            "-c",
            "-o",
            "/dev/null",
        ),
    )


def test_clang_tidy_finds_nothing() -> None:
    """With a quick look of its analyzer; gcc's looks deep."""
    need("clang-tidy")
    shallow = ("-Xclang", "-analyzer-config", "-Xclang", "mode=shallow")
    each([*MODULES, *EXAMPLES], "clang-tidy", "--quiet", last=("--", "-std=c99", *shallow, *INCLUDE, *SEAMS))


def test_cppcheck_finds_nothing() -> None:
    need("cppcheck")
    run(
        *("cppcheck", "--enable=warning,style,performance,portability", "--std=c99", "--error-exitcode=1", "-q"),
        *(*INCLUDE, *SEAMS, "-DMSBOT_CAN_DATA=8"),
        *MODULES,
        *EXAMPLES,
    )


def test_link_and_joining_fit_into_6_kib_of_flash_and_1_kib_of_ram() -> None:
    need("arm-none-eabi-gcc")
    table = run(sys.executable, SOURCES / "sizes.py", "--check")
    assert "| a whole part | cortex-m4 |" in table


def test_the_sketch_for_arduino_is_clean_c_plus_plus() -> None:
    need("g++")
    examples = SOURCES / "examples"
    run(
        *("g++", "-std=c++11", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", *INCLUDE, "-I", examples),
        *("-I", examples / "seams" / "arduino", "-x", "c++", examples / "arduino" / "pin_board" / "pin_board.ino"),
    )


@pytest.mark.parametrize("example", ["stm32f405_qemu", "stm32f4_bxcan", "stm32g4_fdcan"])
def test_an_example_is_built(example: str, tmp_path: Path) -> None:
    need("arm-none-eabi-gcc")
    program = link_example(example, tmp_path)
    assert program.stat().st_size > 10_000


def test_the_example_for_linux_is_built(tmp_path: Path) -> None:
    need("gcc")
    examples = SOURCES / "examples"
    main = (examples / "pin_board.c", examples / "linux_socketcan" / "main.c")
    run("gcc", *WARNINGS, "-O2", *INCLUDE, *MODULES, *main, "-o", tmp_path / "board")


@pytest.mark.parametrize(
    ("test", "sources"),
    [
        ("test_bxcan", ("examples/bxcan.c",)),
        ("test_micro_xrce_dds", ("examples/micro_xrce_dds.c", "msbot_can.c", "msbot_compact.c", "msbot_deflate.c")),
    ],
)
def test_a_driver_on_a_model_of_what_it_drives(test: str, sources: tuple[str, ...], tmp_path: Path) -> None:
    need("gcc")
    paths = [SOURCES / source for source in (f"host/{test}.c", *sources)]
    run("gcc", *WARNINGS, *SANITIZERS, "-DBXCAN_MODEL", *INCLUDE, *SEAMS, *paths, "-o", tmp_path / "test")
    run(tmp_path / "test")


def test_a_fuzzer_finds_nothing(tmp_path: Path) -> None:
    need("clang")
    sanitizers = ("-g", "-O1", "-fsanitize=fuzzer,address,undefined", "-fno-sanitize-recover=all")
    fuzzer = tmp_path / "fuzz"
    run("clang", *sanitizers, *INCLUDE, SOURCES / "host" / "fuzz.c", *MODULES, "-o", fuzzer)
    corpus = tmp_path / "corpus"
    corpus.mkdir()
    report = run(fuzzer, f"-runs={FUZZ_RUNS}", "-max_len=400", "-seed=1", f"-artifact_prefix={tmp_path}/", corpus)
    assert f"Done {FUZZ_RUNS} runs" in report

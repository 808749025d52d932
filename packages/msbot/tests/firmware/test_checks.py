"""The C code under the compilers' and checkers' eyes, its size, its examples, and a fuzzer."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.firmware.building import (
    CORTEX_M4,
    SANITIZERS,
    SOURCES,
    WARNINGS,
    compiled,
    judged,
    link_example,
    linux_board,
    need,
    run,
)

MODULES = sorted(SOURCES.glob("msbot_*.c"))
EXAMPLES = sorted((SOURCES / "examples").glob("*.c"))
INCLUDE = ("-I", str(SOURCES))
SEAMS = tuple(
    word for seam in ("freertos", "micro_xrce_dds", "zephyr") for word in ("-I", str(SOURCES / "examples/seams" / seam))
)
"""Declarations in place of the libraries that the examples are for."""
FUZZ_RUNS = 5_000


def each(name: str, paths: list[Path], *command: str, last: tuple[str, ...] = ()) -> None:
    """Have a checker look at each file, two at a time."""

    def ask() -> str:
        with ThreadPoolExecutor(2) as pool:
            return "".join(pool.map(lambda path: run(*command, path, *last), paths))

    judged(name, ask, command, paths, last, tools=command[:1])


def test_it_is_clean_c99_for_gcc_and_its_analyzer() -> None:
    need("gcc")
    each("gcc", MODULES, "gcc", *WARNINGS, "-O2", "-fanalyzer", *INCLUDE, "-c", "-o", "/dev/null")
    assert not any("malloc" in path.read_text() for path in MODULES)


@pytest.mark.parametrize("core", ["cortex-m0", "cortex-m4"])
def test_it_is_clean_for_a_microcontroller(core: str) -> None:
    need("arm-none-eabi-gcc")
    options = (f"-mcpu={core}", *CORTEX_M4[1:], *WARNINGS, *INCLUDE, *SEAMS)
    each(core, [*MODULES, *EXAMPLES], "arm-none-eabi-gcc", *options, "-c", "-o", "/dev/null")


def test_clang_tidy_finds_nothing() -> None:
    """With a quick look of its analyzer; gcc's looks deep."""
    need("clang-tidy")
    shallow = ("-Xclang", "-analyzer-config", "-Xclang", "mode=shallow")
    last = ("--", "-std=c99", *shallow, *INCLUDE, *SEAMS)
    each("clang-tidy", [*MODULES, *EXAMPLES], "clang-tidy", "--quiet", last=last)


def test_cppcheck_finds_nothing() -> None:
    need("cppcheck")
    looking = ("cppcheck", "--enable=warning,style,performance,portability", "--std=c99", "--error-exitcode=1", "-q")
    command = [*looking, *INCLUDE, *SEAMS, "-DMSBOT_CAN_DATA=8", *map(str, [*MODULES, *EXAMPLES])]
    judged("cppcheck", lambda: run(*command), command, tools=["cppcheck"])


def test_link_and_joining_fit_into_7_kib_of_flash_and_1_kib_of_ram() -> None:
    need("arm-none-eabi-gcc")
    command = (sys.executable, SOURCES / "sizes.py", "--check")
    table = judged("sizes", lambda: run(*command), command, tools=["arm-none-eabi-gcc"])
    assert "* a whole part: flash" in table


CPLUSPLUS = """
static bool level = false;
static int served(void *, const uint8_t *request, size_t, uint8_t *reply) { reply[0] = request[0]; return 1; }
static void ended(void *, const uint8_t *, size_t, const char *) {}

int main()
{
    static const msbot_port_type ports[] = {{"give", "Switch -> Switch", MSBOT_SERVES},
                                            {"ask", "Switch -> Switch", MSBOT_CALLS}};
    msbot_part_config config{};
    config.can.uid[0] = 1;
    config.random = 1;
    config.part_number = config.local_name = "CPP";
    config.ports = ports;
    config.port_count = 2;
    config.context = &level;
    static msbot_part part;
    if (msbot_part_init(&part, &config) != MSBOT_CONFIG_FUNCTIONS) return 1;
    config.safe = [](void *context, int) { *static_cast<bool *>(context) = true; };
    if (msbot_part_init(&part, &config) != MSBOT_CONFIG_OK || !level) return 2;
    if (!msbot_part_serve(&part, 0, served, nullptr) || msbot_part_serve(&part, 1, served, nullptr)) return 3;
    const uint8_t on[1] = {1};
    const char *why = msbot_part_call(&part, 1, on, 1, 1000000, ended, nullptr, 0);
    return why != nullptr && std::strcmp(why, "the part is not active") == 0 ? 0 : 4;
}
"""


def test_the_headers_are_clean_c_plus_plus_and_link_with_objects_in_c(tmp_path: Path) -> None:
    """All of them; the modules are compiled as C, the program as C++."""
    need("gcc", "g++")
    headers = [*sorted(SOURCES.glob("msbot_*.h")), *sorted((SOURCES / "examples").glob("*.h"))]
    included = [path for path in headers if path.name != "cortex_m.h"]
    lines = ["#include <cstring>", *(f'#include "{path}"' for path in included)]
    (tmp_path / "main.cpp").write_text("\n".join(lines) + CPLUSPLUS)
    objects = [tmp_path / f"{path.stem}.o" for path in MODULES]
    for source, made in zip(MODULES, objects, strict=True):
        run("gcc", *WARNINGS, "-c", source, "-o", made)
    command = ("g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", *INCLUDE, *SEAMS)
    run(*command, tmp_path / "main.cpp", *objects, "-o", tmp_path / "program")
    run(tmp_path / "program")


def test_the_sketch_for_arduino_is_clean_c_plus_plus() -> None:
    need("g++")
    examples = SOURCES / "examples"
    run(
        *("g++", "-std=c++11", "-Wall", "-Wextra", "-Werror", "-fsyntax-only", *INCLUDE, "-I", examples),
        *("-I", examples / "seams" / "arduino", "-x", "c++", examples / "arduino" / "pin_board" / "pin_board.ino"),
    )


@pytest.mark.parametrize("example", ["stm32f405_qemu", "stm32f4_bxcan", "stm32g4_fdcan"])
def test_an_example_is_built(example: str) -> None:
    need("arm-none-eabi-gcc")
    program = link_example(example)
    assert program.stat().st_size > 10_000


def test_the_example_for_linux_is_built() -> None:
    need("gcc")
    assert linux_board().stat().st_size > 10_000


@pytest.mark.parametrize(
    ("test", "sources"),
    [
        ("test_bxcan", ("examples/bxcan.c",)),
        ("test_micro_xrce_dds", ("examples/micro_xrce_dds.c", "msbot_can.c", "msbot_compact.c", "msbot_deflate.c")),
    ],
)
def test_a_driver_on_a_model_of_what_it_drives(test: str, sources: tuple[str, ...]) -> None:
    need("gcc")
    paths = [SOURCES / source for source in (f"host/{test}.c", *sources)]
    run(compiled(test, "gcc", *WARNINGS, *SANITIZERS, "-DBXCAN_MODEL", *INCLUDE, *SEAMS, *paths))


def test_a_fuzzer_finds_nothing(tmp_path: Path) -> None:
    """From the same seed it tries the same inputs every time."""
    need("clang")
    sanitizers = ("-g", "-O1", "-fsanitize=fuzzer,address,undefined", "-fno-sanitize-recover=all")
    build = ["clang", *sanitizers, *INCLUDE, *map(str, [SOURCES / "host" / "fuzz.c", *MODULES])]
    tries = (f"-runs={FUZZ_RUNS}", "-max_len=400", "-seed=1")

    def ask() -> str:
        corpus = tmp_path / "corpus"
        corpus.mkdir()
        run(*build, "-o", tmp_path / "fuzz")
        return run(tmp_path / "fuzz", *tries, f"-artifact_prefix={tmp_path}/", corpus)

    assert f"Done {FUZZ_RUNS} runs" in judged("fuzzer", ask, build, tries, tools=["clang"])

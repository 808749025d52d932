"""Programs of others with a typed topic, built from `foreign/Hello.idl` by their own tools, and kept."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from struct import pack

import pytest

from tests.kept import kept

SOURCES = Path(__file__).with_name("foreign")
TYPE = "HelloWorldData::Msg"

Command = tuple[str, ...]


def message(number: int, text: str | None = None) -> bytes:
    """A `HelloWorldData::Msg` as its body of CDR."""
    words = f"hello {number}" if text is None else text
    return pack("<iI", number, len(words) + 1) + words.encode() + b"\0"


def command_of(kind: str) -> Command:
    """How to run the peer of that kind, built if need be; skips the test when a tool is missing."""
    if kind == "python":
        pytest.importorskip("cyclonedds", reason="the Python package cyclonedds is not installed")
        return (sys.executable, str(SOURCES / "typed_peer.py"))
    build, tools, packages, library = BUILDS[kind]
    missing = [tool for tool in tools if shutil.which(tool) is None]
    if missing:
        refuse(f"{', '.join(missing)} are not installed: apt install {packages}")

    def make(folder: Path) -> None:
        for source in SOURCES.glob("*.*"):
            shutil.copy(source, folder)
        build(folder)

    return (str(kept(f"dds-{kind}", make, tools=(*tools, library), told=(), of=SOURCES) / "peer"),)


def refuse(reason: str) -> None:
    """Skip a test, unless everything has to be there."""
    if os.environ.get("MSBOT_NEED_DDS"):
        pytest.fail(f"MSBOT_NEED_DDS is set: {reason}")
    pytest.skip(reason)


def _build_cyclone(folder: Path) -> None:
    _run(folder, "idlc", "-l", "c", "-x", "final", "Hello.idl")
    _run(folder, "gcc", "-I.", "cyclone_peer.c", "Hello.c", "-o", "peer", "-lddsc")


def _build_fast(folder: Path) -> None:
    _run(folder, "fastddsgen", "-replace", "-t", str(folder), "Hello.idl")
    _run(
        folder,
        "g++",
        "-O0",
        "-std=c++14",
        "-I.",
        "fast_peer.cpp",
        "Hello.cxx",
        "HelloPubSubTypes.cxx",
        "-o",
        "peer",
        "-lfastrtps",
        "-lfastcdr",
    )


def _run(folder: Path, *command: str) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"


HEADERS = "/usr/include"
BUILDS: dict[str, tuple[Callable[[Path], None], tuple[str, ...], str, str]] = {
    "cyclone": (_build_cyclone, ("idlc", "gcc"), "cyclonedds-tools cyclonedds-dev gcc", f"{HEADERS}/dds/dds.h"),
    "fast": (_build_fast, ("fastddsgen", "g++"), "fastddsgen libfastrtps-dev g++", f"{HEADERS}/fastrtps/config"),
}
"""How each is built, by which programs, from which packages, and a file of the library that is compiled in."""
KINDS = ("cyclone", "python", "fast")

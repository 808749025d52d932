"""Genuine ROS 2 for these tests: packages of the Python registry in an environment of their own, in `build/kept`."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from contextlib import AbstractAsyncContextManager
from functools import cache
from pathlib import Path

import pytest

from tests.kept import kept
from tests.space.dds.peers import Program, program

PROGRAMS = Path(__file__).with_name("programs")
PYTHON = "3.11"
"""For which the packages are made, on x86-64."""
PACKAGES = (
    "ros-jazzy-rclpy", "ros-jazzy-rmw-fastrtps-cpp", "ros-jazzy-std-msgs", "ros-jazzy-std-srvs",
    "ros-jazzy-sensor-msgs", "ros-jazzy-geometry-msgs", "ros-jazzy-nav-msgs", "ros-jazzy-diagnostic-msgs",
    "ros-jazzy-test-msgs",
)  # fmt: skip


def refuse(reason: str) -> None:
    """Skip a test, unless everything has to be there."""
    if os.environ.get("MSBOT_NEED_ROS"):
        pytest.fail(f"MSBOT_NEED_ROS is set: {reason}")
    pytest.skip(reason)


@cache
def environment() -> Path:
    """The environment with ROS 2 Jazzy; the test is skipped where there is none for this computer."""
    python = _python()
    if python is None or platform.machine() != "x86_64" or not sys.platform.startswith("linux"):
        refuse(f"ROS 2 comes as packages for Python {PYTHON} on x86-64 Linux only")
    assert python is not None

    def make(folder: Path) -> None:
        _run(python, "-m", "venv", str(folder / "ros"))
        _run(str(folder / "ros/bin/python"), "-m", "pip", "install", "-q", *PACKAGES)

    try:
        return kept("ros-jazzy", make, tools=(python,), told=PACKAGES, of=PROGRAMS / "nothing") / "ros"
    except subprocess.CalledProcessError as error:
        refuse(f"ROS 2 cannot be installed: {error.stderr[-500:]}")
        raise


def ros_program(name: str, *arguments: str, **variables: str) -> AbstractAsyncContextManager[Program]:
    """Run a program of ours with genuine ROS 2."""
    place = environment()
    surroundings = {
        "LD_LIBRARY_PATH": str(place / "lib"),
        "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
        "ROS_LOG_DIR": str(place / "log"),
        "PYTHONPATH": "",
        **variables,
    }
    return program(str(place / "bin/python"), str(PROGRAMS / name), *arguments, environment=surroundings)


def _python() -> str | None:
    if sys.version_info[:2] == (3, 11):
        return str(Path(sys.base_prefix) / "bin" / f"python{PYTHON}")
    return shutil.which(f"python{PYTHON}")


def _run(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True, text=True)

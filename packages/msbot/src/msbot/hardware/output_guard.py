"""Makes outputs safe when the program that drives them is killed: a small process that outlives it.

`main` reads lines of JSON from its standard input: `{"hold": KEY, "class": ENTRY POINT,
"wiring": {...}}` when a driver has been opened, `{"free": KEY}` when it was closed. It does nothing else while its
input is open. When the input ends (the system closes it however the other program dies, even by kill -9), it opens each
driver that is still held and closes it again, both of which make its outputs safe. So it needs no rules of its own.

It ignores Ctrl-C, SIGTERM and SIGHUP, which go to the whole group of processes or the whole service.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping

from msbot.config import PartType, load_library
from msbot.hardware.driver import Driver, Mount, driver_class
from msbot.hardware.hardware_fault import HardwareFault
from msbot.hardware.machine import Machine
from msbot.hardware.wiring import PartWiring
from msbot_xrce.errors import ConfigError

ATTEMPTS = 20
RETRY_S = 0.1
"""Time between two tries: the kernel takes some milliseconds to release the pins of a dead program."""

_log = logging.getLogger(__name__)


class OutputGuard:
    """This program's handle on the process, which is started with the first driver that has outputs."""

    def __init__(self, command: list[str]) -> None:
        self._command = command
        self._process: subprocess.Popen[bytes] | None = None

    def hold(self, key: str, part_type: PartType, wiring: PartWiring) -> None:
        """From now on, make the outputs of this driver safe when this program dies."""
        self._say(
            {
                "hold": key,
                "class": part_type.driver.entry_point,
                "number": part_type.number,
                "source": part_type.source,
                "wiring": as_json(wiring),
            }
        )

    def free(self, key: str) -> None:
        """The driver has been closed."""
        if self._process is not None:
            self._say({"free": key})

    def end(self) -> None:
        """End the process, after all drivers are closed."""
        process, self._process = self._process, None
        if process is not None and process.stdin is not None:
            with contextlib.suppress(OSError):
                process.stdin.close()
            process.wait()

    def _say(self, line: Mapping[str, object]) -> None:
        if not self._command:
            return
        if self._process is None or self._process.poll() is not None:
            # A session of its own, so that signals to this program's group do not reach it.
            self._process = subprocess.Popen(
                self._command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, start_new_session=True
            )
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(line).encode() + b"\n")
            self._process.stdin.flush()
        except OSError:
            _log.warning("the process that makes outputs safe has ended: kill -9 would leave them as they are")


def as_json(wiring: PartWiring) -> dict[str, object]:
    """A wiring as JSON."""
    return {
        "pins": dict(wiring.pins),
        "channels": {name: list(place) for name, place in wiring.channels.items()},
        "i2c": None if wiring.i2c is None else list(wiring.i2c),
        "device": wiring.device,
        "options": dict(wiring.options),
    }


def from_json(values: Mapping[str, object]) -> PartWiring:
    """The wiring in JSON written by `as_json`."""
    text = json.dumps(values)
    found = json.loads(text)
    return PartWiring(
        pins=found["pins"],
        channels={name: (place[0], place[1]) for name, place in found["channels"].items()},
        i2c=None if found["i2c"] is None else (found["i2c"][0], found["i2c"][1]),
        device=found["device"],
        options=found["options"],
    )


def keep(lines: Iterable[bytes], machine: Machine, wait: Callable[[float], None] = time.sleep) -> list[str]:
    """Read until the other program ends, then make safe what is still held; returns what could not be made safe."""
    held: dict[str, tuple[str, str, PartWiring]] = {}
    for line in lines:
        said = json.loads(line)
        if "free" in said:
            held.pop(said["free"], None)
        else:
            held[said["hold"]] = (said["number"], said["source"], from_json(said["wiring"]))
    return [f"{key}: {fault}" for key, kept in held.items() if (fault := _make_safe(kept, machine, wait))]


def _make_safe(kept: tuple[str, str, PartWiring], machine: Machine, wait: Callable[[float], None]) -> str:
    """Open and close one driver; returns why that failed, if it did."""
    number, source, wiring = kept
    fault = ""
    for _ in range(ATTEMPTS):
        try:
            driver = _driver(number, source, wiring, machine)
            try:
                driver.open()
            finally:
                driver.close()
        except (HardwareFault, ConfigError) as error:
            fault = str(error)
            wait(RETRY_S)
        else:
            return ""
    return fault


def _driver(number: str, source: str, wiring: PartWiring, machine: Machine) -> Driver:
    from pathlib import Path

    own = Path(source)
    part_type = load_library(*([own] if own.suffix == ".toml" and own.exists() else [])).require(number)
    return driver_class(part_type)(Mount(part_type, wiring, machine))


def main() -> None:
    """Watch over the program at the other end of the standard input."""
    for number in ("SIGINT", "SIGTERM", "SIGHUP"):
        if hasattr(signal, number):
            signal.signal(getattr(signal, number), signal.SIG_IGN)
    faults = keep(sys.stdin.buffer, Machine(keeper=[]))
    for fault in faults:
        with contextlib.suppress(OSError):
            os.write(2, f"msbot: not made safe: {fault}\n".encode())
    sys.exit(1 if faults else 0)

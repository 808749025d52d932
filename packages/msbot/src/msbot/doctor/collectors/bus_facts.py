"""Facts about CAN interfaces, serial ports and I2C."""

from __future__ import annotations

import errno
import os
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

from msbot.doctor.collectors.machine_facts import command_line_of, running_programs, target_of
from msbot.doctor.facts import CanFacts, I2cFacts, SerialFacts
from msbot.doctor.finding import CannotSee, Examined, NotNeeded
from msbot.hardware import Machine
from msbot.hardware.hardware_fault import HardwareFault
from msbot_agent.link.can import parse_target
from msbot_agent.link.can.adapters import Wanted, can_interfaces
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError

MEDDLERS = ("ModemManager", "brltty")
SERIAL = ("ttyUSB*", "ttyACM*", "ttyAMA*")
UNUSED_ADDRESS = 0x78
"""Reserved by the I2C bus specification (3.1.12, ten-bit addressing): no chip answers there with an empty write."""


def can(patient: Examined) -> CanFacts:
    """The CAN interfaces."""
    if not sys.platform.startswith("linux"):
        raise CannotSee(said("only Linux tells about its CAN interfaces"))
    wanted = []
    for rest in patient.of_kind("can", "canfd", "can-legacy"):
        try:
            target = parse_target(rest)
        except ConfigError:
            continue  # `msbot doctor` itself refuses such an address
        if target.interface == "socketcan":
            wanted.append(Wanted(target.channel, bool(target.fd), target.bitrate, target.data_bitrate))
    return CanFacts(_has_socketcan(), tuple(can_interfaces()), tuple(wanted))


def _has_socketcan() -> bool:
    try:
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


def serial(patient: Examined) -> SerialFacts:
    """Serial ports."""
    if not sys.platform.startswith("linux"):
        raise CannotSee(said("serial ports are examined on Linux only"))
    there = [str(path) for pattern in SERIAL for path in sorted(Path("/dev").glob(pattern))]
    wanted = [
        port for rest in patient.of_kind("serial") for port in rest.partition("?")[0].split(",") if port.startswith("/")
    ]
    there += [port for port in wanted if port not in there and Path(port).exists()]
    names = {name for _, name in running_programs()}
    held = {port: holder for port in wanted if (holder := _holder(port))}
    return SerialFacts(tuple(there), tuple(wanted), held, tuple(name for name in MEDDLERS if name in names))


def _holder(port: str) -> str:
    """Another program that has a port open, as far as this user may see."""
    real = os.path.realpath(port)
    for pid, name in running_programs():
        if pid == os.getpid():
            continue
        try:
            files = list(Path(f"/proc/{pid}/fd").iterdir())
        except OSError:
            continue  # of another user, or ended
        if any(target_of(file) == real for file in files) and "msbot" not in command_line_of(pid):
            return f"{name} ({pid})"
    return ""


def i2c(_: Examined, machine: Machine | None = None) -> I2cFacts:
    """I2C buses; each is asked at an address at which nobody is."""
    machine = machine or Machine()
    model = machine.path("/proc/device-tree/model")
    board = model.read_text("ascii", "replace").strip("\0\n ") if model.exists() else ""
    buses = sorted(int(path.name[4:]) for path in machine.path("/dev").glob("i2c-*") if path.name[4:].isdecimal())
    if not buses and not board:
        raise NotNeeded(said("this computer has no I2C"))
    return I2cFacts(board, tuple(buses), tuple(_stuck(machine, buses)))


def _stuck(machine: Machine, buses: list[int]) -> Iterator[int]:
    for number in buses:
        try:
            bus = machine.open_i2c(number)
        except HardwareFault:
            continue  # `permissions` tells
        try:
            bus.write_quick(UNUSED_ADDRESS)
        except OSError as error:
            if error.errno == errno.ETIMEDOUT:
                yield number
        finally:
            bus.close()

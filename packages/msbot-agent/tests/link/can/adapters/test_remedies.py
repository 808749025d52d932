from __future__ import annotations

import errno
import os
from dataclasses import replace

import pytest

from msbot_agent.link.can.adapters.interface import CanInterface
from msbot_agent.link.can.adapters.remedies import (
    NO_KERNEL_SUPPORT,
    Wanted,
    open_error,
    restart_advice,
    up_commands,
    why_not,
)

CAN0 = CanInterface("can0", 3, is_can=True, is_up=True, mtu=16, kind="can", bitrate=500_000)
FD0 = replace(CAN0, mtu=72, data_bitrate=2_000_000)
VCAN0 = CanInterface("vcan0", 4, is_can=True, is_up=True, mtu=72, kind="vcan")
ETH0 = CanInterface("eth0", 2, is_can=False, is_up=True, mtu=1500)


@pytest.mark.parametrize(
    ("wanted", "found"),
    [
        (Wanted("can0"), CAN0),
        (Wanted("can0", bitrate=500_000), CAN0),
        (Wanted("can0"), FD0),
        (Wanted("can0", fd=True, bitrate=500_000, data_bitrate=2_000_000), FD0),
        (Wanted("vcan0", fd=True, bitrate=500_000), VCAN0),
    ],
)
def test_an_interface_that_fits_has_no_problem(wanted: Wanted, found: CanInterface) -> None:
    assert why_not(wanted, found, []) == ""


@pytest.mark.parametrize(
    ("wanted", "found", "words"),
    [
        (
            Wanted("can0"),
            None,
            "there is no interface can0 (there are: vcan0): plug the adapter in, then "
            "`sudo ip link set can0 up type can bitrate 500000` brings it up",
        ),
        (
            Wanted("vcan1"),
            None,
            "there is no interface vcan1 (there are: vcan0): "
            "`sudo ip link add dev vcan1 type vcan && sudo ip link set vcan1 mtu 72 up` makes it",
        ),
        (Wanted("eth0"), ETH0, "eth0 is no CAN interface (there are: vcan0)"),
        (
            Wanted("can0"),
            replace(CAN0, is_up=False, bitrate=None),
            "the interface can0 is down: `sudo ip link set can0 up type can bitrate 500000` brings it up",
        ),
        (
            Wanted("can0", fd=True, bitrate=250_000),
            replace(CAN0, is_up=False, bitrate=None),
            "the interface can0 is down: "
            "`sudo ip link set can0 up type can bitrate 250000 dbitrate 2000000 fd on` brings it up",
        ),
        (
            Wanted("vcan0"),
            replace(VCAN0, is_up=False),
            "the interface vcan0 is down: `sudo ip link set vcan0 mtu 72 up` brings it up",
        ),
        (
            Wanted("can0", fd=True),
            CAN0,
            "CAN FD is asked for, but the interface can0 takes classic frames only (mtu 16): "
            "`sudo ip link set can0 down && "
            "sudo ip link set can0 up type can bitrate 500000 dbitrate 2000000 fd on` changes that",
        ),
        (
            Wanted("vcan0", fd=True),
            replace(VCAN0, mtu=16),
            "CAN FD is asked for, but the interface vcan0 takes classic frames only (mtu 16): "
            "`sudo ip link set vcan0 down && sudo ip link set vcan0 mtu 72 up` changes that",
        ),
        (
            Wanted("can0", bitrate=250_000),
            CAN0,
            "the interface can0 runs at a bit rate of 500000, the address says 250000: "
            "`sudo ip link set can0 down && sudo ip link set can0 up type can bitrate 250000` sets it",
        ),
        (
            Wanted("can0", fd=True, data_bitrate=5_000_000),
            FD0,
            "the interface can0 runs at a data bit rate of 2000000, the address says 5000000: `sudo ip link set can0 "
            "down && sudo ip link set can0 up type can bitrate 500000 dbitrate 5000000 fd on` sets it",
        ),
        (
            Wanted("can0"),
            replace(CAN0, listen_only=True),
            "the interface can0 only listens: `sudo ip link set can0 down && "
            "sudo ip link set can0 up type can listen-only off` lets it send",
        ),
    ],
)
def test_a_problem_names_the_commands_that_help(wanted: Wanted, found: CanInterface | None, words: str) -> None:
    assert why_not(wanted, found, [VCAN0]) == words


def test_without_any_can_interface_none_are_listed() -> None:
    assert why_not(Wanted("can0"), None, []).startswith("there is no interface can0: plug")


def test_commands_keep_the_rates_that_the_interface_has() -> None:
    assert up_commands(Wanted("can0"), replace(CAN0, bitrate=125_000)).endswith("bitrate 125000")
    assert up_commands(Wanted("can0", bitrate=10_000), CAN0).endswith("bitrate 10000")


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.EAFNOSUPPORT, NO_KERNEL_SUPPORT),
        (errno.EPROTONOSUPPORT, NO_KERNEL_SUPPORT),
        (errno.EPERM, NO_KERNEL_SUPPORT),
        (errno.ENODEV, "there is no interface can0: plug the adapter in"),
        (errno.ENOMEM, "cannot use the interface can0: Cannot allocate memory"),
    ],
)
def test_what_the_kernel_says_when_a_socket_is_opened(number: int, words: str) -> None:
    assert open_error(Wanted("can0"), OSError(number, os.strerror(number))).startswith(words)


def test_advice_after_a_restart_that_failed() -> None:
    assert "sudo ip link set can0 type can restart" in restart_advice("can0", OSError(errno.EPERM, ""))
    assert "restart-ms 100" in restart_advice("can0", OSError(errno.EPERM, ""))
    assert "its driver cannot restart" in restart_advice("can0", OSError(errno.EOPNOTSUPP, ""))

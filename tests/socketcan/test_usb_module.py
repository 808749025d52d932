"""The USB module as a real USB serial device: `dummy_hcd` is a USB bus in the kernel, `g_serial` a device on it, which
the kernel's driver cdc-acm takes for what it says it is: /dev/ttyACM0, as with the thesis' NUMATO-8."""

from __future__ import annotations

import os
import threading
import time
import tty
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from msbot.hardware import HardwareFault
from msbot.hardware.serial_stream import SerialStream
from msbot.part import NumatoGpio, PinDirection
from msbot_xrce.errors import LinkDown
from tests.hardware.usb_module import Module
from tests.socketcan.bus import PATIENCE_S
from tests.socketcan.kernel_modules import load, unload

pytestmark = pytest.mark.controllers
ACM = Path("/dev/ttyACM0")


def until(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


class UsbModule(Module):
    """The module behind a USB gadget."""

    def plug_in(self) -> None:
        load("g_serial")
        until(Path("/dev/ttyGS0").exists)
        until(ACM.exists)
        self._ours = os.open("/dev/ttyGS0", os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._ours)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def pull_out(self) -> None:
        os.write(self._close, b"x")
        assert self._thread is not None
        self._thread.join(10)
        os.read(self._closing, 1)
        os.close(self._ours)
        self._thread = None
        until(lambda: unload("g_serial"))
        until(lambda: not ACM.exists())


@pytest.fixture
def module() -> Iterator[UsbModule]:
    load("cdc-acm")
    load("dummy_hcd")
    load("usb_f_acm")  # g_serial would ask for it by modprobe, which the machine has not
    module = UsbModule(ACM)
    module.plug_in()
    yield module
    module.end()
    for name in ("usb_f_acm", "dummy_hcd", "cdc-acm"):
        unload(name)


def test_the_module_at_a_real_usb_serial_device_is_driven_pulled_out_and_plugged_in(module: UsbModule) -> None:
    stream = SerialStream(str(ACM), 115_200, "the USB module")
    gpio = NumatoGpio(stream, timeout_s=PATIENCE_S)
    for pin in range(8):
        gpio.set_direction(pin, PinDirection.OUTPUT)
        gpio.set(pin)
        assert gpio.read(pin)
        assert module.board.levels()[pin]
        gpio.clear(pin)
    assert gpio.read_all() == 0
    module.pull_out()
    with pytest.raises(LinkDown):
        gpio.set(0)
    stream.close()
    with pytest.raises(HardwareFault, match="is it plugged in"):
        SerialStream(str(ACM), 115_200, "the USB module")
    module.plug_in()
    again = SerialStream(str(ACM), 115_200, "the USB module")
    assert NumatoGpio(again, timeout_s=PATIENCE_S).read_all() == 0
    again.close()

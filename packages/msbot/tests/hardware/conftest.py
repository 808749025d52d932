"""Pins that are not there: gpiozero's mock pins, new for each test, with the time of the test."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from gpiozero import Device
from gpiozero.pins.mock import MockFactory, MockPWMPin


@pytest.fixture
def pins() -> Iterator[Any]:
    """The factory; `pins.pin(17).state` is a level or a duty cycle, `drive_high()` is the world outside."""
    factory = MockFactory(pin_class=MockPWMPin)
    Device.pin_factory = factory
    yield factory
    factory.close()
    Device.pin_factory = None

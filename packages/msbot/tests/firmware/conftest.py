"""One firmware on a pipe for all tests of a run: its state is set anew by each of them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.firmware.building import need, pipe_program
from tests.firmware.pipe import Firmware


@pytest.fixture(scope="session")
def firmware() -> Iterator[Firmware]:
    need("gcc")
    running = Firmware(pipe_program())
    yield running
    running.close()

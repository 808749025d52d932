"""What is made at the start and stays until the end: no garbage is looked for in it, neither then nor later."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def made_to_stay() -> Iterator[None]:
    """Suspend garbage collection while something large is loaded, and exempt all that is there from it for good.

    This saves a sixth of the time to start, and long pauses later while the robot runs.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()

"""Runs `msbot`, and writes at its end how long its main thread was importing, as JSON; for `bench/startup.py`.

python -P bench/import_share.py FILE COMMAND ...
"""

from __future__ import annotations

import atexit
import builtins
import importlib
import json
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


class ImportClock:
    """Adds up the time of all imports in the thread that has made it; those inside of others count once."""

    def __init__(self) -> None:
        self.real_s = self.processor_s = 0.0
        self._depth = 0
        self._thread = threading.get_ident()

    def timed(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, whose calls are measured from now on."""

        def call(*arguments: object, **named: object) -> object:
            if threading.get_ident() != self._thread or self._depth:
                return function(*arguments, **named)
            self._depth = 1
            real, processor = time.perf_counter(), time.thread_time()
            try:
                return function(*arguments, **named)
            finally:
                self._depth = 0
                self.real_s += time.perf_counter() - real
                self.processor_s += time.thread_time() - processor

        return call


def main() -> None:
    """Measure and run."""
    clock, result = ImportClock(), Path(sys.argv.pop(1))
    builtins.__import__ = clock.timed(builtins.__import__)
    importlib.import_module = clock.timed(importlib.import_module)
    atexit.register(
        lambda: result.write_text(json.dumps({"real_ms": clock.real_s * 1e3, "processor_ms": clock.processor_s * 1e3}))
    )
    from msbot_command import main as run

    sys.argv[0] = "msbot"
    run()


if __name__ == "__main__":
    main()

"""Standard input, output and error that a program was started without.

`msbot master robot.toml >&-`, a starter of daemons, or Python without a console on Windows: `sys.stdout` is None, and
the next socket that is opened gets the number 1. What would have been written there goes nowhere instead.
"""

from __future__ import annotations

import os
import sys


def fill_closed_streams() -> None:
    """Open the null device in place of each standard stream that is closed."""
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest number that is free: this one
    if sys.stdin is None:
        sys.stdin = open(os.devnull, encoding="utf-8")  # noqa: SIM115 - as long as the program
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115

"""What the tests of `msbot.process.worker_pool` have done elsewhere; each process imports it, so it imports little."""

from __future__ import annotations

import os
import sys

from msbot_xrce.errors import ConfigError


def process_number() -> int:
    return os.getpid()


def processor_limits() -> tuple[int, int]:
    assert sys.platform != "win32"
    import resource  # there is none on Windows

    return resource.getrlimit(resource.RLIMIT_CPU)


def refuse(words: str) -> None:
    raise ConfigError(words)


def fail() -> None:
    raise KeyError("a bug")


def chatter() -> str:
    print("a library says something")
    return "done"


def eat_memory() -> int:
    return len(bytearray(1 << 30))


def eat_time() -> None:
    while True:
        pass

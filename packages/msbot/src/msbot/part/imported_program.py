"""A test imports a part's program for its message classes or functions: the part is then made, and not run."""

from __future__ import annotations

import logging
import sys

from msbot_agent.process.user_folders import own_folders

_log = logging.getLogger("msbot.part")


def is_imported_by_test() -> bool:
    """Whether the program that says `run` is a module that something imports, in a process that tests parts.

    Such a part would join the robot that happens to run on this computer, and the import would never end. Without a
    test nothing is held back: a program may be started by an import, as `main.py` of a board does.
    """
    if "msbot.testing" not in sys.modules:  # pytest loads it in each run
        return False
    frame = sys._getframe(1)  # noqa: SLF001 - nothing else says whose program it is
    while frame.f_back is not None and frame.f_code.co_filename.startswith(own_folders()):
        frame = frame.f_back
    if frame.f_code.co_name != "<module>" or frame.f_globals.get("__name__") == "__main__":
        return False
    _log.info("%s is imported by a test: its part does not run", frame.f_globals.get("__name__"))
    return True

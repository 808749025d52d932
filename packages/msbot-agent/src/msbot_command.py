"""What `msbot` begins with: from here on Ctrl-C shows no traceback, not even while MsBOT itself is imported.

Python prints an interrupt in two places besides `except`: where nothing catches it, and where nothing can, as in the
callback of a weak reference (each import has some). There it would be lost, too, so that it is raised again.

It stands outside of the packages and imports only what Python has loaded already: the import of a package takes longer
than a finger. Python itself begins before that, and prints one there, too: the scripts of `tools/set_up.py` and of
Debian's package start it with SIGINT blocked, and here it is let through.
"""

from __future__ import annotations

import _thread
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from types import TracebackType
    from typing import NoReturn

INTERRUPTED = 130
"""The exit status, `ExitStatus.INTERRUPTED`."""
MOST_CAUSES = 10
"""So many errors that were made of each other are looked at."""


def main() -> None:
    """Entry point of the command."""
    without_traceback()
    try:
        heed_interrupts()
        from msbot_agent.cli import main as run

        run()
    except KeyboardInterrupt:
        end()
    except Exception as error:
        if not is_interrupt(error):
            raise
        end()


def is_interrupt(error: BaseException | None) -> bool:
    """Whether an error is, or was caused by, Ctrl-C: while it makes a class, Python 3.11 makes another error of it."""
    for _ in range(MOST_CAUSES):
        if error is None or isinstance(error, KeyboardInterrupt):
            break
        error = error.__cause__
    return isinstance(error, KeyboardInterrupt)


def heed_interrupts() -> None:
    """Let SIGINT through, also one that has come already; so every program that is started from here gets it, too.

    Raises:
        KeyboardInterrupt: one has come.
    """
    import signal

    if sys.platform != "win32":
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


def end() -> NoReturn:
    """End the program because of Ctrl-C."""
    complain("broken off before it was done")
    sys.exit(INTERRUPTED)


def complain(words: str) -> None:
    """Say on standard error what is wrong, where there is somebody to hear it."""
    try:  # `contextlib` is not loaded yet
        print(f"msbot: {words}", file=sys.stderr, flush=True)
    except OSError:
        return


def without_traceback() -> None:
    """From now on; who has set hooks of their own (pytest has) keeps them."""
    if sys.excepthook is sys.__excepthook__:
        sys.excepthook = _uncaught
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = _unraisable


def _uncaught(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if not issubclass(kind, KeyboardInterrupt):  # of one, Python tells the shell by how it ends
        sys.__excepthook__(kind, error, trace)


def _unraisable(lost: sys.UnraisableHookArgs) -> None:
    if not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)
    elif not sys.is_finalizing():
        _thread.interrupt_main()

"""Tells students about mistakes that Python would not report, or not in a friendly way.

* A program that makes a part and forgets `part.run()` gets a warning when it ends.
* A mistake that MsBOT recognises is one sentence with the line of the program, not a traceback, in any thread.
* A function that blocks is reported while it blocks: `HandlerWatch` looks from a thread of its own.
"""

from __future__ import annotations

import atexit
import logging
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol
from weakref import WeakSet

from msbot.part.join.joining import Joining, JoinState
from msbot.part.join.thesis_messages import DOES_NOT_JOIN
from msbot.part.program_mistakes import sentence, tell_mistakes_as_sentences
from msbot_agent.process.user_folders import own_folders
from msbot_xrce.errors import MsbotError

STUCK_S = 0.5
"""A function that has not returned for this long is reported."""

SILENCE_S = (2.0, 10.0, 60.0)
"""After this many seconds, a part that is still waiting says what it is waiting for."""

_log = logging.getLogger("msbot.part")


class _NamedPart(Protocol):
    """A `Part`, as far as this file needs one."""

    @property
    def local_name(self) -> str: ...


class _Waiting:
    """Parts of this program that nobody has run yet."""

    def __init__(self) -> None:
        self.parts: WeakSet[_NamedPart] = WeakSet()
        self.places: dict[int, str] = {}
        self.is_installed = False


_waiting = _Waiting()


def part_was_made(part: _NamedPart) -> None:
    """Note a part made by a program (not a library, test or prompt); its mistakes are shown as sentences from now
    on."""
    place = _place_in_main()
    if place is None:
        return
    _waiting.parts.add(part)
    _waiting.places[id(part)] = place
    if not _waiting.is_installed:
        _waiting.is_installed = True
        atexit.register(_say_what_was_forgotten)
        tell_mistakes_as_sentences()
        threading.excepthook = _thread_as_sentence(threading.excepthook)


def part_is_run(part: _NamedPart) -> None:
    """The part is being run, so no warning is needed."""
    _waiting.parts.discard(part)
    _waiting.places.pop(id(part), None)


def silence_words(joining: Joining, link: str, local_name: str) -> str:
    """What a part that has been in this state for seconds is waiting for; "" = nothing, or it was said."""
    match joining.state:
        case JoinState.LOOKING | JoinState.LOST:
            return f"no master at {link} yet, still looking; is `msbot master` running?"
        case JoinState.RECOGNISING:
            return f"an agent answers at {link}, but no master has said which robot it is yet; is it `msbot agent`?"
        case JoinState.CLAIMING if joining.reason == DOES_NOT_JOIN:
            return ""
        case JoinState.CLAIMING:
            return f"the robot does not answer part {local_name}; `msbot why {local_name}` beside the master says why"
        case _:
            return ""


class HandlerWatch:
    """Checks from a thread of its own whether a function of the program is stuck, and says in which line.

    Args:
        running: the function now running in the loop's thread and when it began (`time.monotonic`), or None.
    """

    def __init__(self, running: Callable[[], tuple[str, float] | None]) -> None:
        self._running = running
        self._loop_thread = threading.get_ident()
        self._told: set[str] = set()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._look, name="msbot handler watch", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Stop looking."""
        self._ended.set()
        self._thread.join(1.0)

    def _look(self) -> None:
        while not self._ended.wait(STUCK_S / 2):
            running = self._running()
            if running is None:
                continue
            name, since = running
            if time.monotonic() - since < STUCK_S or name in self._told:
                continue
            self._told.add(name)
            where = self._where() or name
            _log.error(
                "%s: %s has not returned yet, and the part cannot beat meanwhile: it must not sleep or wait; "
                "do a little at a time below @part.every(seconds)",
                where,
                name,
            )

    def _where(self) -> str | None:
        frame = sys._current_frames().get(self._loop_thread)  # noqa: SLF001 - the documented way to ask
        while frame is not None:
            path = frame.f_code.co_filename
            if not path.startswith((*own_folders(), "<")) and "lib/python" not in path:
                return f"{Path(path).name}:{frame.f_lineno}"
            frame = frame.f_back
        return None


def _place_in_main() -> str | None:
    if sys.flags.interactive or hasattr(sys, "ps1"):
        return None
    frame = sys._getframe(1)  # noqa: SLF001 - nothing else says whose program it is
    while frame is not None:
        if frame.f_code.co_filename.startswith(tuple(str(Path(folder, "cli")) for folder in own_folders())):
            return None  # `msbot part`, whose script is nobody's program
        if frame.f_globals.get("__name__") == "__main__" and not frame.f_code.co_filename.startswith(own_folders()):
            return f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}"
        if frame.f_back is None:
            return None
        frame = frame.f_back
    return None


def _say_what_was_forgotten() -> None:
    if hasattr(sys, "last_type"):
        return  # the program has ended with an error, which has already been reported
    for part in _waiting.parts:
        place = _waiting.places.get(id(part), "")
        sys.stderr.write(
            f"{place}: part {part.local_name} was made and never run: end the program with part.run(), "
            "or msbot.run(part, ...) for several\n"
        )


def _thread_as_sentence(
    before: Callable[[threading.ExceptHookArgs], object],
) -> Callable[[threading.ExceptHookArgs], object]:
    def say(args: threading.ExceptHookArgs, /) -> None:
        if isinstance(args.exc_value, MsbotError):
            sys.stderr.write(f"{sentence(args.exc_value)}\n")
        else:
            before(args)

    return say

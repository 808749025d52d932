"""Standard output and standard error that never make a robot wait.

A terminal stands still when somebody presses Ctrl-S, marks text in a window of Windows, or leaves a pager open; a pipe
does when nobody reads it. Whoever writes to it then waits, and a robot whose loop waits neither hears beats nor obeys
STOP. Here a thread writes, and what it cannot get rid of is bounded: beyond that, lines are counted and not kept.

Nor does a robot end because of what it says: where nothing can be written (the disk of the log is full, the terminal or
the reader of the pipe is gone), lines are counted, the other stream tells it once, and the robot goes on.
"""

from __future__ import annotations

import io
import logging
import os
import sys
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from time import monotonic
from typing import Any, Final, TextIO

from msbot_xrce.counting import amount

MOST_WAITING: Final = 1 << 18
"""Characters that wait to be written."""
PATIENCE_S: Final = 2.0
"""At the end of a program, the time for what still waits."""


class NonBlockingOutput(io.TextIOBase):
    """Looks like the stream that it stands for; `write` returns at once."""

    def __init__(self, stream: TextIO, thread: _Thread) -> None:
        self._stream = stream
        self._thread = thread

    def write(self, text: str, /) -> int:
        """Have the text written soon; what cannot be written is counted, and told as soon as it can be."""
        if not isinstance(text, str):
            raise TypeError(f"a text is needed, not {type(text).__name__}")
        return self._thread.take(self._stream, text)

    def flush(self) -> None:
        """Nothing: the thread writes as soon as it can."""

    def isatty(self) -> bool:
        """As the stream."""
        return self._stream.isatty()

    def fileno(self) -> int:
        """As the stream."""
        return self._stream.fileno()

    def writable(self) -> bool:
        """Yes."""
        return True

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """As the stream."""
        return self._stream.encoding

    @property
    def errors(self) -> str | None:  # type: ignore[override]
        """As the stream."""
        return self._stream.errors


@dataclass(slots=True)
class _Loss:
    """What could not be written to a stream since something could."""

    name: str
    lines: int = 0
    why: str = ""


class _Thread:
    """Writes for both streams, in the order in which the texts came."""

    def __init__(self, output: TextIO, errors: TextIO) -> None:
        self._losses = {output: _Loss("standard output"), errors: _Loss("standard error")}
        self._change = threading.Condition()
        self._texts: deque[tuple[TextIO, str]] = deque()
        self._waiting = 0
        self._left_out = 0
        self._is_over = False
        threading.Thread(target=self._run, name="msbot output", daemon=True).start()

    def take(self, stream: TextIO, text: str) -> int:
        with self._change:
            if self._is_over:
                self._give(stream, text)
            elif self._left_out or self._waiting + len(text) > MOST_WAITING:
                # Until all that waits is written: one gap, not many.
                self._left_out += max(1, text.count("\n"))
            else:
                self._texts.append((stream, text))
                self._waiting += len(text)
                self._change.notify_all()
        return len(text)

    def end(self, patience_s: float) -> None:
        """Write what waits; what is written later is written at once."""
        until = monotonic() + patience_s
        with self._change:
            while self._waiting and (left := until - monotonic()) > 0:
                self._change.wait(left)
            self._is_over = not self._waiting  # else the thread still has the stream, and stands still with it

    def _gap(self) -> int:
        """How many lines were left out after what was written, if that was all."""
        with self._change:
            if self._texts:
                return 0
            left_out, self._left_out = self._left_out, 0
            return left_out

    def _run(self) -> None:
        while True:
            with self._change:
                while not self._texts:
                    self._change.wait()
                stream, text = self._texts.popleft()
            self._give(stream, text)
            if left_out := self._gap():
                lines, took = amount(left_out, "line is", "lines are"), "it" if left_out == 1 else "them"
                self._give(stream, f"({lines} not shown: nobody took {took})\n")
            with self._change:
                self._waiting -= len(text)
                self._change.notify_all()

    def _give(self, stream: TextIO, text: str) -> None:
        """Write it, after a note of what was lost before; what cannot be written is lost."""
        loss = self._losses[stream]
        # A line may have been written in part: the note begins on a new one.
        note = f"\n({amount(loss.lines, 'line is', 'lines are')} lost: {loss.why})\n" if loss.lines else ""
        try:
            _write(stream, note + text)
        except OSError as error:
            is_first = not loss.lines
            loss.lines += max(1, text.count("\n"))
            loss.why = error.strerror or str(error)
            if is_first:
                self._tell_others(stream, f"{loss.name} takes nothing any more ({loss.why}): its lines are lost\n")
        else:
            loss.lines = 0

    def _tell_others(self, stream: TextIO, words: str) -> None:
        for other, loss in self._losses.items():
            if other is not stream and not loss.lines:
                with suppress(OSError):  # both may go to the same place
                    _write(other, words)


def _write(stream: TextIO, text: str) -> None:
    if sys.platform == "win32":  # a console there takes texts, not octets
        stream.write(text)
        stream.flush()
        return
    # Past Python's own buffer: a thread that stands still in it would keep the program from ending.
    octets = text.encode(stream.encoding, stream.errors or "strict")
    while octets:
        octets = octets[os.write(stream.fileno(), octets) :]


@contextmanager
def nonblocking_output(patience_s: float = PATIENCE_S) -> Iterator[None]:
    """Within this, `sys.stdout` and `sys.stderr` never make their writer wait.

    Args:
        patience_s: how long the end waits until everything is written.
    """
    before = sys.stdout, sys.stderr
    try:
        for stream in before:
            stream.flush()
            stream.fileno()
    except (OSError, ValueError):  # not streams of the system, as in a test: nobody waits for them
        yield
        return
    thread = _Thread(*before)
    patient = NonBlockingOutput(before[0], thread), NonBlockingOutput(before[1], thread)
    sys.stdout, sys.stderr = patient
    _exchange_streams(before, patient)
    try:
        yield
    finally:
        thread.end(patience_s)
        sys.stdout, sys.stderr = before
        _exchange_streams(patient, before)


def _exchange_streams(present: Sequence[Any], other: Sequence[Any]) -> None:
    """Let the log go to the other streams wherever it goes to the present ones."""
    for log in logging.getLogger().handlers:
        if isinstance(log, logging.StreamHandler) and log.stream in present:
            log.setStream(other[present.index(log.stream)])


# Standard input, output and error that a program was started without.
#
# `msbot master robot.toml >&-`, a starter of daemons, or Python without a console on Windows: `sys.stdout` is None, and
# the next socket that is opened gets the number 1. What would have been written there goes nowhere instead.


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

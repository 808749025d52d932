"""What strangers put into log lines stays a text on one line, and floods are counted."""

from __future__ import annotations

import io
import logging
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.log import (
    BURST,
    BURST_S,
    LONGEST_S,
    MOST_KINDS,
    REPEAT_S,
    SAME,
    TerminalHandler,
    plain,
    write_by_root_alone,
)


class Terminal:
    """A handler, its output, and a clock."""

    def __init__(self) -> None:
        self.stream = io.StringIO()
        self.handler = TerminalHandler("%(message)s", self.stream)
        self.now = 1000.0

    def say(self, text: str, *arguments: object, line: int = 1) -> None:
        record = logging.LogRecord("msbot.x", logging.WARNING, "x.py", line, text, arguments, None)
        record.created = self.now
        self.handler.handle(record)

    @property
    def lines(self) -> list[str]:
        return self.stream.getvalue().splitlines()


@pytest.mark.parametrize(
    ("hostile", "shown"),
    [
        ("\x1b[31mred\x1b[0m", "\\x1b[31mred\\x1b[0m"),
        ("name\n12:00:00 STOP was pressed by teacher", "name\\n12:00:00 STOP was pressed by teacher"),
        ("\r\x9b2J", "\\r\\x9b2J"),
        ("abc\u202edcba", "abc\\u202edcba"),
        ("Motörchen ☂", "Motörchen ☂"),
    ],
)
def test_a_text_from_outside_cannot_forge_or_colour_anything(hostile: str, shown: str) -> None:
    terminal = Terminal()
    terminal.say("part %s is refused", hostile)
    assert terminal.lines == [f"part {shown} is refused"]


@given(st.text())
def test_any_text_is_one_printable_line(text: str) -> None:
    assert len(f"{plain(text)}.".splitlines()) == 1
    assert "\x1b" not in plain(text)


def test_the_same_line_is_written_a_few_times_a_minute_and_counted_beyond() -> None:
    terminal = Terminal()
    for _ in range(200_000 // 1000):
        terminal.say("no more file descriptors")
    assert terminal.lines == ["no more file descriptors"] * SAME
    terminal.now += REPEAT_S
    terminal.say("no more file descriptors")
    assert terminal.lines[SAME:] == [f"({200 - SAME} more like it were not written) no more file descriptors"]


def test_a_flood_of_one_kind_is_counted_although_each_line_differs_and_others_come_through() -> None:
    terminal = Terminal()
    for number in range(500):
        terminal.say("client %d logged in", number)
    terminal.say("STOP was pressed", line=2)
    assert len(terminal.lines) == BURST + 1
    assert terminal.lines[-1] == "STOP was pressed"
    terminal.now += BURST_S
    terminal.say("client %d logged in", 1000)
    assert terminal.lines[BURST + 1 :] == [f"({500 - BURST} more like it were not written) client 499 logged in"]


def test_a_flood_is_told_at_growing_intervals_and_who_comes_after_it_is_written_again() -> None:
    terminal = Terminal()
    for second in range(24 * 3600):
        for _ in range(3):
            terminal.say("request %d is none", second)
        terminal.now += 1.0
    assert len(terminal.lines) < BURST + 40
    before = len(terminal.lines)
    terminal.now += 2 * LONGEST_S
    terminal.say("another", line=2)
    terminal.now += 2 * LONGEST_S
    terminal.say("another", line=2)
    terminal.say("request %d is none", 1)
    assert terminal.lines[-1] == "request 1 is none"
    assert len(terminal.lines) <= before + 5


def test_texts_without_end_from_one_place_do_not_push_out_what_is_known_of_others() -> None:
    terminal = Terminal()
    for _ in range(100):
        terminal.say("the same", line=1)
    for number in range(10 * MOST_KINDS):
        terminal.say("text %d", number, line=2)
    terminal.say("the same", line=1)
    assert terminal.lines.count("the same") == SAME


def test_handlers_that_a_library_has_given_its_logger_are_taken_away() -> None:
    library, stream = logging.getLogger("some.library"), io.StringIO()
    library.addHandler(logging.StreamHandler(stream))
    library.propagate = False
    write_by_root_alone()
    seen: list[str] = []
    root = logging.getLogger()
    handler = logging.Handler()
    handler.emit = lambda record: seen.append(record.getMessage())  # type: ignore[method-assign]
    root.addHandler(handler)
    try:
        library.warning("hello")
    finally:
        root.removeHandler(handler)
    assert seen == ["hello"]
    assert not stream.getvalue()


def test_what_is_remembered_is_bounded_and_told_at_the_end() -> None:
    terminal = Terminal()
    for number in range(3 * MOST_KINDS):
        terminal.say("kind %d", number, line=number)
    assert len(terminal.handler._limiter) <= 2 * MOST_KINDS
    for _ in range(SAME + 1):
        terminal.say("again")
    terminal.handler.close()
    assert terminal.lines[-1] == "(1 more like it were not written) again"


def test_a_traceback_keeps_its_lines_and_loses_its_escape_sequences() -> None:
    terminal = Terminal()
    try:
        raise ValueError("\x1b[2Jgone")
    except ValueError:
        record = logging.LogRecord("msbot", logging.ERROR, "x.py", 9, "failed", None, sys.exc_info())
    terminal.handler.handle(record)
    assert terminal.lines[0] == "failed"
    assert terminal.lines[-1] == "ValueError: \\x1b[2Jgone"

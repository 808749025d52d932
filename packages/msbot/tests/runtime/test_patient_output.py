"""Output that never makes a robot wait: a pipe that nobody reads, or has gone, a full disk, the end."""

from __future__ import annotations

import errno
import logging
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

import pytest

from msbot_agent.process.nonblocking_output import MOST_WAITING, nonblocking_output


@contextmanager
def output_to_a_pipe(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Standard output and error go into one pipe; gives its reading end."""
    reading, writing = os.pipe()
    with os.fdopen(writing, "w") as stream, monkeypatch.context() as changed:
        changed.setattr(sys, "stdout", stream)
        changed.setattr(sys, "stderr", stream)
        yield reading
    os.close(reading)


def test_who_writes_into_a_full_pipe_does_not_wait_and_what_is_left_out_is_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    line = "x" * 99 + "\n"
    with output_to_a_pipe(monkeypatch) as reading:
        with nonblocking_output(patience_s=0.0):
            for _ in range(10 * MOST_WAITING // len(line)):
                print(line, end="")  # without the thread this would never end: nobody reads
            seen = b""
            while b"nobody took them" not in seen:
                seen += os.read(reading, 1 << 16)
        lines = seen.decode().splitlines()
        (note,) = [one for one in lines if one.startswith("(")]
        whole = lines.index(note)
        assert set(lines[:whole]) == {line.strip()}
        assert int(note.split()[0][1:]) > 10 * MOST_WAITING // len(line) // 2


def test_everything_is_there_in_its_order_when_it_ends_and_streams_are_as_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with output_to_a_pipe(monkeypatch) as reading:
        before = sys.stdout
        handler = logging.StreamHandler(sys.stderr)
        logging.getLogger().addHandler(handler)
        try:
            with nonblocking_output():
                print("one ä")
                logging.getLogger("test").warning("two")
                print("three", file=sys.stderr)
                late = sys.stdout
            assert sys.stdout is before
            assert handler.stream is before
            late.write("four\n")
        finally:
            logging.getLogger().removeHandler(handler)
        assert os.read(reading, 100).decode() == "one ä\ntwo\nthree\nfour\n"


def test_a_reader_that_has_gone_ends_nobody_and_is_told_once_on_the_other_stream() -> None:
    program = (
        "from msbot_agent.process.nonblocking_output import nonblocking_output\n"
        "with nonblocking_output():\n"
        "    print('line')\n"
        "    input()\n"
        "    for _ in range(1000): print('line')\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"line\n"
        process.stdout.close()
        assert process.stdin is not None
        process.stdin.write(b"\n")
        process.stdin.close()
        assert process.stderr is not None
        said = process.stderr.read()
    assert said == b"standard output takes nothing any more (Broken pipe): its lines are lost\n"
    assert process.returncode == 0


def test_what_a_full_disk_did_not_take_is_counted_and_told_before_the_next_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    written: list[tuple[str, str]] = []
    tried = threading.Semaphore(0)
    full = {"out": False, "err": False}

    def write(stream: TextIO, text: str) -> None:
        tried.release()
        name = "out" if stream is output else "err"
        if full[name]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written.append((name, text))

    def say(text: str, stream: TextIO, tries: int = 1) -> None:
        stream.write(text)
        for _ in range(tries):
            assert tried.acquire(timeout=60)

    with open(os.devnull, "w") as output, open(os.devnull, "w") as errors, monkeypatch.context() as changed:
        changed.setattr(sys, "stdout", output)
        changed.setattr(sys, "stderr", errors)
        changed.setattr("msbot_agent.process.nonblocking_output._write", write)
        with nonblocking_output():
            say("1\n", sys.stdout)
            full["out"] = True
            say("2\n3\n", sys.stdout, tries=2)  # the second is what the other stream tells
            say("4\n", sys.stdout)
            say("a\n", sys.stderr)
            full["out"] = False
            say("5\n", sys.stdout)
            say("6\n", sys.stdout)
            full["out"] = full["err"] = True
            say("7\n", sys.stdout, tries=2)
            late = sys.stdout
        late.write("8\n")  # nobody is troubled by it after the end, either
        full["out"] = False
        late.write("9\n")
    assert written == [
        ("out", "1\n"),
        ("err", "standard output takes nothing any more (No space left on device): its lines are lost\n"),
        ("err", "a\n"),
        ("out", "\n(3 lines are lost: No space left on device)\n5\n"),
        ("out", "6\n"),
        ("out", "\n(2 lines are lost: No space left on device)\n9\n"),
    ]


def test_a_stream_that_is_none_of_the_system_stays(capsys: pytest.CaptureFixture[str]) -> None:
    before = sys.stdout
    with nonblocking_output():
        assert sys.stdout is before
        print("seen")
    assert capsys.readouterr().out == "seen\n"

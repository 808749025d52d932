"""Output that never makes a robot wait: a pipe that nobody reads, a reader that has gone, a program that ends."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from msbot.runtime.patient_output import MOST_WAITING, patient_output


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
        with patient_output(patience_s=0.0):
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
            with patient_output():
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


def test_a_reader_that_has_gone_is_told_as_without_it() -> None:
    program = (
        "from msbot.runtime.patient_output import patient_output\n"
        "with patient_output():\n"
        "    while True: print('line')\n"
    )
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"line\n"
        process.stdout.close()
        assert process.stderr is not None
        assert b"BrokenPipeError" in process.stderr.read()


def test_a_stream_that_is_none_of_the_system_stays(capsys: pytest.CaptureFixture[str]) -> None:
    before = sys.stdout
    with patient_output():
        assert sys.stdout is before
        print("seen")
    assert capsys.readouterr().out == "seen\n"

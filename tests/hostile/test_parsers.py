"""What fuzzing has found in parsers, each once more: it is refused in words, or read."""

from __future__ import annotations

import json
import zlib
from pathlib import Path

import pytest

from fuzz.targets.parsers import PARSERS, read, samples_of
from msbot.cli.bus.frame_log import FrameReader
from msbot.errors import ConfigError
from msbot.runtime.json_reading import read_json
from msbot.runtime.printable import printable

DEEP = b"[" * 100_000


def _blf_with_a_damaged_container() -> bytes:
    octets = bytearray(samples_of("blf")[0])
    at = octets.index(zlib.compress(b"")[:1], 150)
    octets[at : at + 40] = bytes(40)
    return bytes(octets)


@pytest.mark.parametrize(
    ("parser", "octets"),
    [
        pytest.param("arena", b'{"do": {"wheels": {"motor.left": 1%s}}}' % (b"0" * 400), id="no float is so large"),
        pytest.param("arena", DEEP, id="deep line"),
        pytest.param("blocks", b'{"a": "\\ud800"}', id="half a character"),
        pytest.param("stop_answer", DEEP, id="deep answer about STOP"),
        pytest.param("ros", b"int32 a\nuint8 B=\x1b[31m", id="escape sequence in a constant"),
        pytest.param("ros", b"bool[2] flags " + b"[" * 5000, id="deep default"),
        pytest.param("candump", "can0 123 [2] DE\u00a0AD".encode(), id="another space"),
        pytest.param("asc", b"date Wed\x1b[31m\nbase hex", id="escape sequence in a log"),
        pytest.param("recording", b"\x89MCAP\r\r\n" + bytes(40), id="a version that controls the terminal"),
        pytest.param("recording", b"\x89MCAP0\r\n" + bytes(40), id="octets that are no record"),
    ],
)
def test_what_was_found_is_read_or_refused_in_printable_words(parser: str, octets: bytes) -> None:
    read(parser, octets)


def test_a_damaged_log_of_another_program_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "a.blf"
    path.write_bytes(_blf_with_a_damaged_container())
    with pytest.raises(ConfigError, match=r"a\.blf is no \.blf file that python-can understands"):
        list(FrameReader().read(str(path)))


@pytest.mark.parametrize("note", [b"{", DEEP, b"[]", b"7", b"{}", b'{"began_ms": "x"}', b'{"began_ms": 5, "head": 3}'])
def test_notes_of_a_mission_that_make_no_sense_are_passed_over(note: bytes) -> None:
    good = samples_of("recording")[0]
    notes = json.loads(good[good.index(b'{"slot"') : good.index(b"}}", good.index(b'{"slot"')) + 2])
    wanted = json.dumps(notes).encode()
    assert wanted in good  # without compression, so that it can be exchanged for something of the same length
    damaged = good.replace(wanted, note[: len(wanted)].ljust(len(wanted)), 3)
    read("recording", damaged)


def test_deep_json_is_an_error_of_value() -> None:
    with pytest.raises(ValueError, match="nested too deeply"):
        read_json(DEEP)
    assert read_json(b'{"a": 1}') == {"a": 1}


def test_what_controls_a_terminal_is_shown_as_question_marks() -> None:
    assert printable("plain ä") == "plain ä"
    assert printable("a\x1b[31m\nb\u2028") == "a?[31m?b?"


@pytest.mark.parametrize("name", PARSERS)
def test_every_sample_is_read(name: str) -> None:
    assert samples_of(name)
    for sample in samples_of(name):
        assert read(name, sample)

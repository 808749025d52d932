"""The file with STOP has its room from the start, and a record that was cut off half way means STOP."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import asdict, replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.master.stop_persistence import PLACE_OCTETS, PLACES, BrokenRecord, StopFile, encoded, newest, older_place
from msbot.pnp import StopRecord

STOP = StopRecord(3, True, "ann", "fire", 5, 4)
GO = replace(STOP, holds=False, by="bob", reason="")
BLANK = b" " * (PLACE_OCTETS - 1) + b"\n"


def test_what_was_written_last_is_read_and_the_file_never_grows(tmp_path: Path) -> None:
    file = StopFile(tmp_path / "a" / "stop.json")
    assert file.read() is None
    file.prepare()
    assert file.read() is None
    node = file.path.stat().st_ino
    for number in range(1, 9):
        for record in (replace(STOP, number=number), replace(GO, number=number)):
            file.write(record)
            assert file.read() == record
            assert (file.path.stat().st_size, file.path.stat().st_ino) == (PLACES * PLACE_OCTETS, node)
    file.close()
    assert file.path.stat().st_mode & 0o077 == 0
    assert [one.name for one in file.path.parent.iterdir()] == ["stop.json"]


@pytest.mark.parametrize("cut", [1, 20, 60, 100])
def test_a_record_that_was_cut_off_means_stop_whatever_the_other_one_says(tmp_path: Path, cut: int) -> None:
    """The power failed while a place was being written."""
    file = StopFile(tmp_path / "stop.json")
    file.write(GO)
    whole = bytearray(file.path.read_bytes())
    begun = encoded(replace(STOP, number=4, reason="x" * 100))
    whole[PLACE_OCTETS : PLACE_OCTETS + cut] = begun[:cut]
    file.path.write_bytes(whole)
    with pytest.raises(BrokenRecord) as broken:
        StopFile(file.path).read()
    assert broken.value.number == GO.number
    again = StopFile(file.path)
    again.write(replace(STOP, number=5))
    assert again.read() == replace(STOP, number=5), "it took the place of what was broken"


def test_a_mixture_of_two_records_is_not_taken_for_one(tmp_path: Path) -> None:
    file = StopFile(tmp_path / "stop.json")
    file.write(STOP)
    octets = bytearray(file.path.read_bytes())
    at = octets.index(b'"holds": true')
    octets[at : at + 13] = b'"holds":false'
    file.path.write_bytes(octets)
    with pytest.raises(BrokenRecord):
        file.read()


def test_a_file_of_before_is_read_and_gets_its_room(tmp_path: Path) -> None:
    path = tmp_path / "stop.json"
    old = {name: value for name, value in asdict(STOP).items() if name != "latest"}
    path.write_text(json.dumps(old))
    file = StopFile(path)
    assert file.read() == replace(STOP, latest=STOP.number)
    file.prepare()
    assert path.stat().st_size == PLACES * PLACE_OCTETS
    assert file.read() == replace(STOP, latest=STOP.number)


@pytest.mark.parametrize("content", [b"{half", b"", b"[]", b"null", b'{"check": 1, "stop": {}}', b"\xff" * 9000])
def test_what_nobody_can_read_stays_unread_until_a_record_takes_its_place(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "stop.json"
    path.write_bytes(content)
    file = StopFile(path)
    for _ in range(2):
        with pytest.raises(BrokenRecord):
            file.read()
        file.prepare()
    file.write(STOP)
    assert file.read() == STOP


def test_a_file_that_was_taken_away_or_replaced_is_made_anew(tmp_path: Path) -> None:
    file = StopFile(tmp_path / "stop.json")
    file.write(STOP)
    file.path.unlink()
    file.write(GO)
    assert file.read() == GO
    other = tmp_path / "other"
    other.write_bytes(BLANK * PLACES)
    other.replace(file.path)
    file.write(STOP)
    assert StopFile(file.path).read() == STOP


@pytest.mark.skipif(sys.platform == "win32", reason="this system has no such limit")
def test_neither_a_descriptor_nor_room_is_needed_after_the_start(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    file = StopFile(tmp_path / "stop.json")
    file.prepare()
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    lowest = os.open(os.devnull, os.O_RDONLY)
    os.close(lowest)
    resource.setrlimit(resource.RLIMIT_NOFILE, (lowest, before[1]))
    try:
        with pytest.raises(OSError, match="Too many open files"):
            os.open(os.devnull, os.O_RDONLY)
        file.write(STOP)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    assert file.read() == STOP


@given(st.integers(1, 2**53), st.booleans(), st.text(max_size=64), st.text(max_size=1000), st.integers(0, 2**63))
def test_every_record_fits_its_place_and_is_read_as_it_was(
    number: int, holds: bool, by: str, reason: str, at_ns: int
) -> None:
    record = StopRecord(number, holds, by, reason, at_ns, number)
    octets = encoded(record)
    assert len(octets) == PLACE_OCTETS
    assert newest(octets + BLANK) == newest(BLANK + octets) == record
    assert (older_place(octets + BLANK), older_place(BLANK + octets)) == (1, 0)


def test_words_that_are_too_long_are_cut_and_halves_of_letters_written_as_marks() -> None:
    found = newest(encoded(StopRecord(1, True, "\ud800", "\x01" * 100_000, 0, 1)) + BLANK)
    assert found is not None
    assert (found.number, found.holds, found.by) == (1, True, "?")
    assert 500 < len(found.reason) < PLACE_OCTETS

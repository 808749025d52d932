"""The ring, the disk and damaged files."""

import errno
import json
import os
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.records import ChunkIndex
from mcap.stream_reader import StreamReader

from msbot.recording.recorder.batch import Kind, RecordingRequest, Unpacker, encode_began, encode_state, head, read_wish
from msbot.recording.recorder.recording_file import (
    LONGEST_S,
    MOST_FILES,
    RecordingFile,
    RingLimits,
    Segment,
    segment_name,
    segments,
    too_old,
)
from msbot.recording.recorder.ring_storage import RETRY_S, Storing
from msbot.recording.recordings.excerpts import write_cut
from msbot.recording.recordings.mcap_reader import RecordingReader, ended_ns
from msbot_xrce.errors import ConfigError
from tests.lab.recorded import BEGAN_NS, NS, channel, messages, sample, store

records = st.lists(
    st.tuples(st.integers(1, 6), st.integers(0, 0xFFFF), st.integers(0, 10**6), st.binary(max_size=40)), max_size=8
)


@given(records, st.lists(st.integers(1, 30), max_size=20))
def test_records_survive_being_cut_anywhere(said: list[tuple[int, int, int, bytes]], cuts: list[int]) -> None:
    octets = head(Kind.BEGAN, 0, 0.0, 8) + encode_began(BEGAN_NS)
    for kind, number, at_s, content in said:
        octets += head(kind, number, float(at_s), len(content)) + content
    unpacker, found = Unpacker(), []
    for size in cuts:
        found += list(unpacker.feed(octets[:size]))
        octets = octets[size:]
    found += list(unpacker.feed(octets))
    assert found == [(kind, number, BEGAN_NS + at_s * NS, content) for kind, number, at_s, content in said]


@given(
    st.lists(st.tuples(st.integers(0, 1000), st.integers(0, 900)), max_size=100),
    st.integers(10, 1000),
    st.integers(100, 5000),
)
def test_a_ring_keeps_its_limits_and_what_is_newest(sizes: list[tuple[int, int]], seconds: int, octets: int) -> None:
    in_time = sorted(sizes, key=lambda one: one[1])
    files = [Segment(Path(segment_name(at_s * NS, n)), size, -1e9) for n, (size, at_s) in enumerate(in_time)]
    limits = RingLimits(float(seconds), octets)
    gone = too_old(files, limits, 1000.0)
    assert gone == [segment.path for segment in files[: len(gone)]]
    kept = files[len(gone) :]
    assert all(segment.began_s + LONGEST_S >= 1000.0 - seconds for segment in kept[:1])
    assert len(kept) < MOST_FILES
    assert sum(segment.octets for segment in kept) <= octets - limits.segment_octets


def test_a_clock_that_is_set_back_costs_nothing_of_the_ring(tmp_path: Path) -> None:
    storing = Storing(tmp_path, RingLimits(100.0, 100 << 20), lambda *_: None)
    storing.take(channel(1, "/fast"), 0.0)
    for second in range(60):
        storing.take(sample(1, float(second), bytes([second])), float(second))
        storing.flush(float(second))
        for path in tmp_path.iterdir():  # what the system says of them is an hour behind the robot's own time
            os.utime(path, (0, BEGAN_NS // NS + second - 3600))
    storing.close()
    paths = [segment.path for segment in segments(tmp_path)]
    said = {one.at_ns for path in paths for one in messages(path) if one.topic == "/fast"}
    assert said == {BEGAN_NS + second * NS for second in range(60)}
    assert ended_ns(paths) == BEGAN_NS + 59 * NS
    assert ended_ns([]) == 0


def test_a_ring_deletes_its_oldest_and_each_file_can_be_read_alone(tmp_path: Path) -> None:
    storing = Storing(tmp_path, RingLimits(100.0, 100 << 20), lambda *_: None)
    storing.take(channel(1, "/slow"), 0.0)
    storing.take(channel(2, "/fast"), 0.0)
    storing.take(sample(1, 0.0, b"known"), 0.0)
    for second in range(300):
        storing.take(sample(2, float(second), bytes([second % 256])), float(second))
        storing.flush(float(second))
    storing.close()
    files = [segment.path for segment in segments(tmp_path)]
    assert 9 <= len(files) <= 40
    for path in files[1:]:
        first = messages(path)[0]
        assert (first.topic, first.data[4:], first.is_repeated) == ("/slow", b"known", True)
    times = [one.at_ns for path in files for one in messages(path) if one.topic == "/fast" and not one.is_repeated]
    assert times == sorted(times)
    assert times[-1] == BEGAN_NS + 299 * NS


def test_a_cut_of_the_ring_has_everything_once_and_what_was_known_before(tmp_path: Path) -> None:
    storing = Storing(tmp_path / "ring", RingLimits(1000.0, 100 << 20), lambda *_: None)
    storing.take(channel(1, "/slow"), 0.0)
    storing.take(channel(2, "/fast"), 0.0)
    storing.take(sample(1, 0.0, b"known"), 0.0)
    for second in range(300):
        storing.take(sample(2, float(second), bytes([second % 256])), 0.0)
        storing.flush(0.0)
    storing.close()
    paths = [segment.path for segment in segments(tmp_path / "ring")]
    assert len(paths) > 3
    write_cut(paths, tmp_path / "whole.mcap")
    assert [one.data[4:] for one in messages(tmp_path / "whole.mcap")] == [
        b"known",
        *(bytes([second % 256]) for second in range(300)),
    ]
    cut = write_cut(paths, tmp_path / "end.mcap", from_ns=BEGAN_NS + 290 * NS)
    assert cut.messages == 10
    found = messages(tmp_path / "end.mcap")
    assert [(one.topic, one.is_repeated) for one in found[:3]] == [("/slow", True), ("/fast", True), ("/fast", False)]


def test_a_full_disk_costs_the_oldest_then_samples_and_is_told_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[tuple[str, str]] = []
    storing = Storing(tmp_path, RingLimits(100.0, 100 << 20), lambda file, trouble: said.append((file, trouble)))
    storing.take(channel(1, "/msbot/recorder"), 0.0)
    storing.take(channel(2), 0.0)
    for second in range(25):
        storing.take(sample(2, float(second), b"x"), 0.0)
        storing.flush(0.0)
    before = len(segments(tmp_path))
    real = RecordingFile.flush

    def full(_: RecordingFile) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(RecordingFile, "flush", full)
    for second in range(25, 28):
        storing.take(sample(2, float(second), b"x"), 0.0)
        storing.flush(0.0)
    assert said == [(str(tmp_path), "cannot be written: No space left on device")]
    assert len(segments(tmp_path)) <= before
    monkeypatch.setattr(RecordingFile, "flush", real)
    storing.take(sample(2, 40.0, b"y"), RETRY_S + 1)
    storing.flush(RETRY_S + 1)
    storing.close()
    assert said[-1] == (str(tmp_path), "")
    last = messages(segments(tmp_path)[-1].path)
    notes = [json.loads(one.data) for one in last if one.topic == "/msbot/recorder"]
    assert notes
    assert notes[0]["left_out"] >= 1
    assert last[-1].data[4:] == b"y"


def test_states_are_repeated_key_by_key(tmp_path: Path) -> None:
    storing = Storing(tmp_path, RingLimits(100.0, 100 << 20), lambda *_: None)
    storing.take(channel(1), 0.0)
    for key, value in (("a", 1), ("b", 2), ("a", 3)):
        storing.take((Kind.STATE, 1, BEGAN_NS, encode_state(key, value)), 0.0)
    storing.take(sample(1, 11.0, b""), 0.0)
    storing.flush(0.0)
    storing.take(sample(1, 12.0, b""), 0.0)
    storing.close()
    second = messages(segments(tmp_path)[1].path)
    assert sorted(one.data for one in second if one.is_repeated and one.data in (b"1", b"2", b"3")) == [b"2", b"3"]


def test_nothing_recorded_is_ever_overwritten(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"precious")
    said: list[tuple[str, str]] = []
    storing = Storing(None, RingLimits(100.0, 100 << 20), lambda file, trouble: said.append((file, trouble)))
    storing.take((Kind.START, 0, 0, str(tmp_path / "a.mcap").encode()), 0.0)
    assert said == [(str(tmp_path / "a.mcap"), "cannot be written: File exists")]
    assert (tmp_path / "a.mcap").read_bytes() == b"precious"
    store([channel(1), sample(1, 0.0, b"x")], tmp_path / "b.mcap")
    with pytest.raises(ConfigError, match="is there already"):
        write_cut([tmp_path / "b.mcap"], tmp_path / "a.mcap")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "a.mcap"
    store([channel(1), *(sample(1, n / 10, bytes([n])) for n in range(50))], path)
    return path.read_bytes()


@given(data=st.data())
def test_damaged_recordings_are_read_as_far_as_they_go(
    data: st.DataObject, whole: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    octets = bytearray(whole)
    if data.draw(st.booleans()):
        octets = octets[: data.draw(st.integers(0, len(octets) - 1))]
    for _ in range(data.draw(st.integers(0, 3)) if octets else 0):
        octets[data.draw(st.integers(0, len(octets) - 1))] ^= data.draw(st.integers(1, 255))
    path = tmp_path_factory.getbasetemp() / "damaged.mcap"
    path.write_bytes(octets)
    if octets[:8] != whole[:8]:
        with pytest.raises(ConfigError, match=r"damaged\.mcap"):
            list(RecordingReader(path).messages())
        return
    reader = RecordingReader(path)
    found = list(reader.messages())
    assert len(found) <= 50
    assert reader.damage or [one.at_ns for one in found] or octets != whole


def test_a_recording_that_ends_after_its_first_octets_is_one(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "begun.mcap"
    path.write_bytes(whole[:8])
    reader = RecordingReader(path)
    assert list(reader.messages()) == []
    assert reader.damage.startswith("it cannot be read beyond byte 8 ")


def test_a_damaged_chunk_costs_only_what_is_in_it(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    size = 1_000  # a chunk is written when it has a quarter of a megabyte
    store([channel(1), *(sample(1, n / 10, n.to_bytes(2) + bytes(size - 2)) for n in range(1_000))], path)
    with path.open("rb") as stream:
        chunks = [record for record in StreamReader(stream).records if isinstance(record, ChunkIndex)]
    assert len(chunks) >= 4
    octets = bytearray(path.read_bytes())
    for chunk in chunks[:2]:  # the first has the only description of the channel but for that at the end of the file
        octets[chunk.chunk_start_offset + chunk.chunk_length - 20] ^= 0xFF
    path.write_bytes(octets)
    reader = RecordingReader(path)
    found = [int.from_bytes(one.data[4:6]) for one in reader.messages()]
    assert found == list(range(found[0], 1_000))
    assert 400 < found[0] < 600
    assert "2 of its chunks cannot be read, the first ends at byte" in reader.damage
    assert "the others were read" in reader.damage

    path.write_bytes(octets[: chunks[-1].chunk_start_offset])  # without the end: nothing says what the channel is
    assert list(reader.messages()) == []
    assert "messages belong to channels that nothing describes" in reader.damage
    assert "what came before was read" in reader.damage


@pytest.mark.parametrize(
    ("octets", "words"),
    [
        (b"", "is empty"),
        (b"hello, world", "is no recording"),
        (b"\x89MCA", "ends after 4 bytes: nothing is in it"),
        (b"\x89MCAP1\r\n" + bytes(100), "an MCAP file of version 1; this program reads version 0"),
    ],
)
def test_what_is_no_recording_is_told_in_words(octets: bytes, words: str, tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_bytes(octets)
    with pytest.raises(ConfigError, match=words):
        list(RecordingReader(tmp_path / "x.mcap").messages())


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("off", RecordingRequest(on=False)),
        ("10min", RecordingRequest()),
        ("2h", RecordingRequest(seconds=7200.0)),
        ("500MB", RecordingRequest(octets=500 << 20)),
        ("30min, 1GB", RecordingRequest(seconds=1800.0, octets=1 << 30)),
        ("lesson.mcap", RecordingRequest(file=Path("lesson.mcap"))),
        ("a, b.mcap", RecordingRequest(file=Path("a, b.mcap"))),
        ("lesson.mcap, ROS2", RecordingRequest(file=Path("lesson.mcap"), is_bag=True)),
    ],
)
def test_wishes(text: str, expected: RecordingRequest) -> None:
    assert read_wish(text) == expected


@pytest.mark.parametrize(
    "text", ["", "10", "ten minutes", "10min,20min", "1s", "0MB", "-3min", "9999999h", "10min,ros2", "ros2"]
)
def test_wishes_that_are_none(text: str) -> None:
    with pytest.raises(ConfigError, match=f"^{re.escape(repr(text))}: "):
        read_wish(text)

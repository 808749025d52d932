"""A recording is refused where it would end at once, before anybody is told that it has begun."""

from __future__ import annotations

import asyncio
import os
import shutil
from collections import namedtuple
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from msbot.operations import recording_operations as operations
from msbot_xrce.errors import ConfigError

Usage = namedtuple("Usage", "total used free")


class Recorder:
    """Notes what it is to record."""

    def __init__(self) -> None:
        self.files: list[Path] = []

    def record(self, path: Path, *, as_bag: bool) -> None:
        self.files.append(path)

    def end_record(self) -> str:
        return ""

    async def wait_until_complete(self, file: str) -> Sequence[str] | None:
        return ()

    def as_json(self) -> Mapping[str, object]:
        return {}


@pytest.fixture
def recorder() -> Recorder:
    return Recorder()


def begin(recorder: Recorder, path: Path) -> str:
    """What is said when that recording begins, or why it does not."""
    recording = operations.Recording()
    recording.attach(recorder)
    try:
        return str(asyncio.run(recording.record(str(path), "ann", ros2=False)).words)
    except ConfigError as error:
        return str(error)


@pytest.mark.parametrize("free", [0, 1000, 1 << 20])
def test_a_full_disk(free: int, recorder: Recorder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _folder: Usage(1 << 30, (1 << 30) - free, free))
    file = tmp_path / "x.mcap"
    has_room = free == 1 << 20
    assert begin(recorder, file) == (
        f"everything is recorded in {file} from now on"
        if has_room
        else f"{file}: the disk of {tmp_path} is full; delete something"
    )
    assert recorder.files == [file] * has_room


def test_a_folder_that_is_closed(recorder: Recorder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "x.mcap"
    refused = f"{file}: the user of the master may not write into {tmp_path}"
    monkeypatch.setattr(os, "access", lambda _path, _mode: False)
    assert begin(recorder, file) == refused

    def closed(_path: Path) -> bool:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "is_dir", closed)
    assert begin(recorder, file) == refused
    assert recorder.files == []

"""What is made from a file is made once, and anew when the file or its maker is another one."""

from __future__ import annotations

import os
import sys
import tomllib
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from zipfile import Path as PathInArchive
from zipfile import ZipFile

import pytest

from msbot_agent.startup.bytecode_cache import cached_definitions, packaged_toml

CARRIED = sorted(Path(str(files("msbot"))).rglob("*.toml"))


@pytest.fixture
def byte_code(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    monkeypatch.setattr(sys, "pycache_prefix", None)


class Maker:
    """Counts how often it was asked."""

    def __init__(self) -> None:
        self.asked = 0

    def __call__(self, octets: bytes) -> str:
        self.asked += 1
        return f"words = {octets.decode().split()!r}"


@pytest.fixture
def words(tmp_path: Path) -> Path:
    path = tmp_path / "words.text"
    path.write_text("one two")
    return path


@pytest.mark.usefixtures("byte_code")
def test_it_is_made_once(words: Path) -> None:
    maker = Maker()
    assert (
        cached_definitions(words, maker, "a")["words"]
        == cached_definitions(words, maker, "a")["words"]
        == ["one", "two"]
    )
    assert maker.asked == 1


def other_size(path: Path) -> str:
    path.write_text("one two three")
    return "a"


def other_time(path: Path) -> str:
    path.write_text("two one")
    os.utime(path, (1_000_000_000, 1_000_000_000))
    return "a"


def other_mark(_path: Path) -> str:
    return "b"


@pytest.mark.usefixtures("byte_code")
@pytest.mark.parametrize("change", [other_size, other_time, other_mark])
def test_it_is_made_anew_when_something_is_another(words: Path, change: Callable[[Path], str]) -> None:
    maker = Maker()
    cached_definitions(words, maker, "a")
    mark = change(words)
    assert cached_definitions(words, maker, mark)["words"] == words.read_text().split()
    assert maker.asked == 2


def test_nothing_is_kept_where_python_must_not_write(words: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    maker = Maker()
    for _ in range(2):
        assert cached_definitions(words, maker, "a")["words"] == ["one", "two"]
    assert maker.asked == 2
    assert [path.name for path in words.parent.iterdir()] == ["words.text"]


@pytest.mark.usefixtures("byte_code")
def test_what_is_kept_is_of_each_caller_alone(tmp_path: Path) -> None:
    path = tmp_path / "one.toml"
    path.write_text("list = [1]\n[table]\nkey = 1")
    first = packaged_toml(path)
    first["list"].append(2)
    first["table"].clear()
    assert packaged_toml(path) == {"list": [1], "table": {"key": 1}}


@pytest.mark.parametrize("path", CARRIED, ids=lambda path: path.name)
def test_every_file_of_the_package_says_the_same(path: Path) -> None:
    assert packaged_toml(path) == tomllib.loads(path.read_text("utf-8"))


def test_a_package_in_an_archive_is_read_too(tmp_path: Path) -> None:
    with ZipFile(tmp_path / "package.zip", "w") as archive:
        archive.writestr("one.toml", "key = 'value'")
    assert packaged_toml(PathInArchive(tmp_path / "package.zip") / "one.toml") == {"key": "value"}

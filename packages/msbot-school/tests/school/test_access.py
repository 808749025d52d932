"""Accesses are kept in a file for their owner alone, and addresses are spelled in one way."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from msbot_school.classroom import remote_access as kept
from msbot_school.classroom.remote_access import RemoteAccess, RemoteAccessFile, page_address
from msbot_xrce.errors import ConfigError

ONE = RemoteAccess("http://10.0.0.2:8080", "msbot_secret", "ROVER", "X2")


def test_an_access_is_kept_replaced_and_taken_away(tmp_path: Path) -> None:
    book = RemoteAccessFile(tmp_path / "new")
    assert book.all() == []
    book.add(ONE)
    other = RemoteAccess("https://10.0.0.1:443", "msbot_b", "ROVER", "X1", "PEM")
    book.add(other)
    again = RemoteAccess(ONE.address, "msbot_c", "ROVER", "X2")
    book.add(again)
    assert book.all() == [again, other]
    if os.name == "posix":
        assert book.path.stat().st_mode & 0o077 == 0
    book.take_away(again)
    assert book.all() == [other]
    assert "secret" not in repr(ONE)


@pytest.mark.skipif(os.name != "posix", reason="this system has no such rights")
def test_a_file_that_others_can_read_is_not_used(tmp_path: Path) -> None:
    book = RemoteAccessFile(tmp_path)
    book.add(ONE)
    book.path.chmod(0o640)
    with pytest.raises(ConfigError, match="others can read it: chmod 600"):
        book.all()


@pytest.mark.parametrize("text", ["{", "{}", "[1]", '[{"address": "x"}]', json.dumps([{"address": 1}]), "[[]]", "7"])
def test_a_file_that_makes_no_sense_is_one_sentence(text: str, tmp_path: Path) -> None:
    book = RemoteAccessFile(tmp_path)
    book.add(ONE)
    book.path.write_text(text)
    if text == "{}":
        assert book.all() == []
        return
    with pytest.raises(ConfigError, match="move it away"):
        book.all()


def test_accesses_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kept, "MOST", 1)
    book = RemoteAccessFile(tmp_path)
    book.add(ONE)
    with pytest.raises(ConfigError, match="at most 1 robots"):
        book.add(RemoteAccess("http://10.0.0.3:8080", "t", "R", "1"))


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("10.0.0.2:8080", "http://10.0.0.2:8080"),
        ("http://Pi.local:8080/", "http://pi.local:8080"),
        ("https://pi", "https://pi:443"),
        ("http://[fe80::1]:8080", "http://[fe80::1]:8080"),
    ],
)
def test_an_address_has_one_spelling(text: str, address: str) -> None:
    assert page_address(text) == address


@pytest.mark.parametrize(
    "text", ["", "ftp://x", "http://", "http://x:99999", "http://x/path", "http://u:p@x", "http://[x"]
)
def test_what_is_no_address_is_told(text: str) -> None:
    with pytest.raises(ConfigError, match="is no address of a page"):
        page_address(text)

"""UIDs on disk: drawn once, kept, shared by two starts at once, mended by the user when broken."""

import os
from pathlib import Path

import pytest

from msbot.part.join import uid as uid_module
from msbot.part.join.uid import parse_uid, stored_uid
from msbot_xrce.errors import ConfigError

UID = bytes.fromhex("0011223344556677")


@pytest.mark.parametrize("text", ["0011223344556677", "00:11:22:33:44:55:66:77", "00-11 22334455 66 77"])
def test_a_uid_is_read_with_or_without_separators(text: str) -> None:
    assert parse_uid(text) == UID


@pytest.mark.parametrize("text", ["", "0011", "001122334455667788", "00112233445566zz"])
def test_anything_else_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(ConfigError, match="16 hexadecimal digits, for example 0011223344556677"):
        parse_uid(text)


def test_a_uid_is_drawn_once_per_part(tmp_path: Path) -> None:
    first = stored_uid("ABCD", "left eye", tmp_path)
    assert len(first) == 8
    assert stored_uid("ABCD", "left eye", tmp_path) == first
    assert stored_uid("ABCD", "right eye", tmp_path) != first
    assert stored_uid("EFGH", "left eye", tmp_path) != first
    assert sorted(path.name for path in (tmp_path / "uid").iterdir()) == [
        "ABCD.left%20eye",
        "ABCD.right%20eye",
        "EFGH.left%20eye",
    ]


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs files with modes, as POSIX has them")
@pytest.mark.promise("Other users of the computer read neither keys nor UIDs of parts")
def test_other_users_do_not_read_it(tmp_path: Path) -> None:
    (tmp_path / "uid").mkdir()
    (tmp_path / "uid").chmod(0o755)  # of an earlier version
    mask = os.umask(0o022)
    try:
        stored_uid("ABCD", "left eye", tmp_path)
    finally:
        os.umask(mask)
    found = [tmp_path / "uid", *(tmp_path / "uid").iterdir()]
    assert len(found) == 2
    assert [path for path in found if path.stat().st_mode & 0o077] == []


def test_names_cannot_leave_the_folder_or_collide(tmp_path: Path) -> None:
    names = [("..", "../../x"), ("a.b", "c"), ("a", "b.c"), ("é", "%C3%A9"), ("%C3%A9", "é")]
    assert len({stored_uid(number, name, tmp_path) for number, name in names}) == len(names)
    assert len(list((tmp_path / "uid").iterdir())) == len(names)
    assert [path.name for path in tmp_path.iterdir()] == ["uid"]


def test_a_broken_file_is_named(tmp_path: Path) -> None:
    stored_uid("ABCD", "x", tmp_path)
    path = tmp_path / "uid/ABCD.x"
    path.write_text("rubbish")
    with pytest.raises(ConfigError, match=r"ABCD\.x: UID 'rubbish'.*or delete the file"):
        stored_uid("ABCD", "x", tmp_path)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match="or use --uid"):
        stored_uid("ABCD", "x", tmp_path)


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    with pytest.raises(ConfigError, match="or use --uid"):
        stored_uid("ABCD", "x", blocked)


def test_of_two_starts_at_once_both_use_the_uid_that_was_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    real = uid_module.write_for_user_alone

    def overtaken(path: Path, text: str) -> None:
        if path.name.startswith("."):
            real(path.with_name("ABCD.x"), UID.hex())
        real(path, text)

    monkeypatch.setattr(uid_module, "write_for_user_alone", overtaken)
    assert stored_uid("ABCD", "x", tmp_path) == UID
    assert [path.name for path in (tmp_path / "uid").iterdir()] == ["ABCD.x"]

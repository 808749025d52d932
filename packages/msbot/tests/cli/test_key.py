"""`msbot key`: what it prints, what it keeps, what it refuses."""

from __future__ import annotations

import json
import re
import stat
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from msbot.cli.key import command, qr_code
from msbot.config import SAMPLES, load_blueprint, load_library, parse_blueprint, write_sample
from msbot.part.join.part_keys import given_key, parse_key
from msbot.part.join.uid import uid_on_board
from msbot.pnp import Claim, PartEvent, PartState
from msbot.registry import open_registry
from msbot_xrce.errors import ConfigError

UID = "0011223344556677"


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a robot that has seen part AA."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.delenv("MSBOT_KEY", raising=False)
    write_sample(tmp_path / "robot.toml")
    library = load_library()
    with open_registry(tmp_path / "robot.db") as registry:
        robot = registry.robots.apply_blueprint(load_blueprint(tmp_path / "robot.toml", library), library)
        store = registry.runs.begin(robot)
        uid = bytes.fromhex(UID)
        store.remember(uid, "AA", Claim("ABCD", "eye", uid))
        store.journal(
            PartEvent(1.0, "eye", "AA", None, PartState.ACTIVE, "test", part_number="ABCD", local_name="eye", uid=uid)
        )
    return tmp_path


def run(*words: str) -> Result:
    return CliRunner().invoke(command, list(words), catch_exceptions=False)


def shown(output: str) -> tuple[bytes, bytes]:
    uid, key = (re.search(rf"{word} +([0-9a-f-]+)", output) for word in ("UID", "key"))
    assert uid is not None
    assert key is not None
    return bytes.fromhex(uid[1]), parse_key(key[1])


def test_a_new_key_is_printed_as_text_and_qr_code_and_kept(folder: Path) -> None:
    output = run("new", "EFGH").output
    uid, key = shown(output)
    assert len(key) == 16
    assert f"part {uid.hex()} has a key; it is not shown again." in output
    assert qr_code(f"MSBOT1:EFGH:{uid.hex()}:{key.hex()}") in output
    with open_registry(folder / "robot.db", read_only=True) as registry:
        assert registry.keys.find(uid) == key


def test_a_part_that_was_seen_keeps_its_uid_and_gets_another_key_each_time(folder: Path) -> None:
    first, second = shown(run("new", "eye", "--no-qr").output), shown(run("new", "AA", "--no-qr").output)
    assert first[0] == second[0] == bytes.fromhex(UID)
    assert first[1] != second[1]
    assert "█" not in run("new", UID, "--no-qr").output


def test_a_uid_can_be_given(folder: Path) -> None:
    uid, _ = shown(run("new", "ABCD", "--uid", "8877 6655 4433 2211", "--no-qr").output)
    assert uid.hex() == "8877665544332211"


def test_here_keeps_uid_and_key_for_the_program_and_for_nobody_else(folder: Path) -> None:
    output = run("new", "EFGH", "--name", "left", "--here", "--no-qr").output
    uid, key = shown(output)
    assert given_key(None, "EFGH", "left") == key
    path = folder / "state/msbot/key/EFGH.left"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert (folder / "state/msbot/uid/EFGH.left").read_text().strip() == uid.hex()


def test_the_parts_of_a_board_get_its_key(folder: Path) -> None:
    _, key = shown(run("new", "eye", "--no-qr").output)
    output = run("board", "eye", "HC-SR04 front eye: trigger=5, echo=18", "LED").output
    uids = [uid_on_board(bytes.fromhex(UID), *shown) for shown in (("HC-SR04", "front eye"), ("LED", "LED"))]
    assert output.splitlines() == [
        f"{uids[0].hex()}  front eye, part HC-SR04: has the board's key",
        f"{uids[1].hex()}  LED, part LED: has the board's key",
    ]
    with open_registry(folder / "robot.db", read_only=True) as registry:
        assert [registry.keys.find(uid) for uid in uids] == [key, key]


BOARDS = """
[robot]
name = "R"

[[slot]]
name = "front board"
part = "BOARD-8"

[slot.settings]
part_1 = "HC-SR04 eye: trigger=5, echo=18"
part_3 = "LED lamp: s=2"

[[slot]]
name = "rear board"
part = "BOARD-8"
"""
BOARD = "8877665544332211"


@pytest.fixture
def two_boards(folder: Path) -> Path:
    """A robot with two boards; nobody has seen the first, the second was refused because it has no key."""
    library, uid = load_library(), bytes.fromhex(BOARD)
    with open_registry(folder / "robot.db") as registry:
        store = registry.runs.begin(registry.robots.apply_blueprint(parse_blueprint(BOARDS, library=library), library))
        store.journal(
            PartEvent(
                1.0,
                "rear board",
                None,
                None,
                PartState.REFUSED,
                "no key",
                part_number="BOARD-8",
                local_name="rear board",
                uid=uid,
            )
        )
    return folder


def test_the_parts_that_the_slot_of_a_board_says_get_its_key(two_boards: Path) -> None:
    run("new", "BOARD-8", "--uid", "0102030405060708", "--no-qr")
    output = run("board", "0102030405060708", "--slot", "Front Board").output
    uids = [uid_on_board(bytes.fromhex("0102030405060708"), *one) for one in (("HC-SR04", "eye"), ("LED", "lamp"))]
    assert [line.split("  ")[0] for line in output.splitlines()] == [uid.hex() for uid in uids]
    with pytest.raises(ConfigError, match=r'which slot is this board\'s\? .* "front board" of R, "rear board" of R'):
        run("board", "0102030405060708")
    with pytest.raises(ConfigError, match='there is no slot "back" for a board; there are "front board" of R'):
        run("board", "0102030405060708", "--slot", "back")
    with pytest.raises(ConfigError, match="give either what is wired to the board, or --slot"):
        run("board", "0102030405060708", "LED", "--slot", "rear board")


def test_a_board_that_was_refused_is_known_by_the_slot_it_asked_for(two_boards: Path) -> None:
    run("new", "rear board", "--no-qr")
    with pytest.raises(ConfigError, match='nothing is wired to slot "rear board" yet: `msbot set "rear board" part_1'):
        run("board", "rear board")
    assert len(run("board", "rear board", "--slot", "front board").output.splitlines()) == 2


def test_without_a_slot_for_a_board_one_has_to_say_what_is_wired(folder: Path) -> None:
    run("new", "eye", "--no-qr")
    with pytest.raises(ConfigError, match="no robot of this database has a slot for a board: say what is wired to it"):
        run("board", "eye")


def test_the_list_shows_whose_keys_there_are_and_no_key(folder: Path) -> None:
    assert "No part has a key" in run("list").output
    uid, key = shown(run("new", "EFGH", "--no-qr").output)
    run("new", "eye", "--no-qr")
    output = run("list").output
    assert f"{uid.hex()}  " in output
    assert "(not seen yet)" in output
    assert "  eye" in output
    assert key.hex() not in output.replace("-", "")
    listed = json.loads(run("list", "--json").output)
    robot = load_blueprint(folder / "robot.toml", load_library()).robot.name
    known = {(row["uid"], row["part"], row["robot"]) for row in listed}
    assert known == {(uid.hex(), None, None), (UID, "eye", robot)}
    library = load_library()
    with open_registry(folder / "robot.db") as registry:
        registry.robots.apply_blueprint(parse_blueprint(SAMPLES["rover"], library), library)
    assert f"  eye of {robot}" in run("list").output


def test_a_removed_key_is_gone(folder: Path) -> None:
    run("new", "eye", "--no-qr")
    assert run("remove", UID).output == f"the key of part {UID} is removed: it is not let in any more.\n"
    with open_registry(folder / "robot.db", read_only=True) as registry:
        assert registry.keys.all() == []


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("remove", UID), f"part {UID} has no key"),
        (("remove", "nobody"), "UID 'nobody': write 16 hexadecimal digits"),
        (("new", "ABCD", "--uid", "12"), "UID '12': write 16 hexadecimal digits"),
        (("list", "--db", "other.db"), "there is no database other.db"),
    ],
)
def test_what_is_wrong_is_said_in_words(folder: Path, words: tuple[str, ...], says: str) -> None:
    result = CliRunner().invoke(command, list(words))
    assert says in str(result.exception)


def test_a_name_that_two_parts_have_is_not_guessed(folder: Path) -> None:
    library = load_library()
    other = bytes.fromhex("8877665544332211")
    with open_registry(folder / "robot.db") as registry:
        store = registry.runs.begin(
            registry.robots.apply_blueprint(load_blueprint(folder / "robot.toml", library), library)
        )
        store.remember(other, "BB", Claim("EFGH", "eye", other))
    result = CliRunner().invoke(command, ["new", "eye"])
    assert str(result.exception) == f"'eye' may be eye ({UID}), eye ({other.hex()}): give the UID"


def test_without_the_library_for_qr_codes_the_key_holds_all_the_same(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "segno", None)
    result = CliRunner().invoke(command, ["new", "EFGH"])
    assert "pip install 'msbot[master]'" in str(result.exception)
    uid, key = shown(result.output)
    with open_registry(folder / "robot.db", read_only=True) as registry:
        assert registry.keys.find(uid) == key


def test_a_folder_that_cannot_be_written_is_told(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "state").write_text("a file where a folder should be")
    result = CliRunner().invoke(command, ["new", "EFGH", "--uid", UID, "--here"])
    assert "cannot keep it in" in str(result.exception)

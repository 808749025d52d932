"""Keys and proofs: what goes into a proof, how a key is written, where it is found."""

from __future__ import annotations

import hashlib
import hmac
import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from msbot.part.join import part_keys
from msbot.part.join.uid import kept_file
from msbot_xrce.errors import ConfigError
from tests import ROOT

PAGE = (ROOT / "docs/reference/messages.md").read_text()
KEY, NONCE, UID = bytes(range(16)), bytes(range(100, 116)), b"12345678"


def proof(**changes: object) -> bytes:
    values: dict[str, object] = {"part_number": "ABCD", "local_name": "eye", "session_key": 0x01020304, **changes}
    key, nonce, uid = (values.pop(name, given) for name, given in (("key", KEY), ("nonce", NONCE), ("uid", UID)))
    return part_keys.prove(key, nonce, uid, **values)  # type: ignore[arg-type]


def test_a_proof_is_the_first_16_octets_of_the_hmac_over_everything() -> None:
    message = b"MsBOT claim 1\0" + NONCE + UID + b"\0\4ABCD" + b"\0\3eye" + bytes.fromhex("01020304")
    assert proof() == hmac.new(KEY, message, hashlib.sha256).digest()[:16]


def test_the_example_of_the_page_is_right() -> None:
    section = PAGE.partition("### Proofs")[2].partition("###")[0]
    rows = dict(re.findall(r"^\| ([^|]+) \| `([^`]+)`", section, re.MULTILINE))
    key, nonce, part_uid = (bytes.fromhex(rows[name]) for name in ("key", "nonce", "UID"))
    session_key = int(rows["client key"], 16)
    assert rows["part number, local name"] == "ABCD"
    shown = part_keys.prove(key, nonce, part_uid, part_number="ABCD", local_name="eye", session_key=session_key)
    assert shown.hex() == rows["proof"]


@pytest.mark.parametrize(
    "change",
    [
        {"key": bytes(16)},
        {"nonce": bytes(16)},
        {"uid": bytes(8)},
        {"part_number": "ABCE"},
        {"local_name": "ear"},
        {"session_key": 1},
        {"part_number": "ABCDe", "local_name": "ye"},
    ],
)
def test_whatever_is_different_makes_another_proof(change: dict[str, object]) -> None:
    assert not part_keys.is_same(proof(**change), proof())
    assert part_keys.is_same(proof(), proof())


@given(st.binary(min_size=16, max_size=64))
@settings(deadline=None)
def test_a_key_is_read_as_it_is_written(key: bytes) -> None:
    assert part_keys.parse_key(part_keys.key_text(key)) == key
    assert part_keys.parse_key(part_keys.key_text(key).upper() + "\n") == key


@pytest.mark.parametrize("text", ["", "xyz", "00" * 15, "00" * 65, "0" * 33])
def test_what_is_no_key_is_refused_without_repeating_it(text: str) -> None:
    with pytest.raises(ConfigError, match="msbot key new") as caught:
        part_keys.parse_key(text)
    assert not text or text not in str(caught.value)


def test_a_key_is_given_by_digits_file_variable_or_its_kept_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.delenv(part_keys.KEY_VARIABLE, raising=False)
    assert part_keys.given_key(None, "ABCD", "eye") is None
    kept = kept_file("key", "ABCD", "eye")
    kept.parent.mkdir(parents=True)
    kept.write_text("11" * 16 + "\n")
    assert part_keys.given_key(None, "ABCD", "eye") == b"\x11" * 16
    assert part_keys.given_key(None, "ABCD", "ear") is None
    monkeypatch.setenv(part_keys.KEY_VARIABLE, "")
    assert part_keys.given_key(None, "ABCD", "eye") == b"\x11" * 16
    monkeypatch.setenv(part_keys.KEY_VARIABLE, "22" * 16)
    assert part_keys.given_key(None, "ABCD", "eye") == b"\x22" * 16
    assert part_keys.given_key("33" * 16, "ABCD", "eye") == b"\x33" * 16
    other = tmp_path / "other.key"
    other.write_text("44" * 16)
    assert part_keys.given_key(str(other), "ABCD", "eye") == b"\x44" * 16


def test_a_wrong_key_of_the_environment_is_told_by_the_name_of_the_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(part_keys.KEY_VARIABLE, "zz")
    with pytest.raises(ConfigError, match=r"^\$MSBOT_KEY: that is not a key: write 32 hexadecimal digits"):
        part_keys.given_key(None, "ABCD", "eye")


def test_a_file_that_holds_no_key_is_named(tmp_path: Path) -> None:
    path = tmp_path / "my.key"
    path.write_text("hello")
    with pytest.raises(ConfigError, match=r"my\.key: that is not a key"):
        part_keys.given_key(str(path), "ABCD", "eye")
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match=r"my\.key: that is not a key"):
        part_keys.given_key(str(path), "ABCD", "eye")
    with pytest.raises(ConfigError, match="that is not a key"):
        part_keys.given_key("x" * 5000, "ABCD", "eye")

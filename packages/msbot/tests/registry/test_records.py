"""What the registry gives back."""

import dataclasses

import pytest

from msbot.registry.records import PartRecord, ValueRecord, uid_text

PART = PartRecord("R", b"", "ABCD", "ABCD-local", "AA", "active", "because", "udp", 1, 2)


def test_a_part_is_called_by_its_local_name_else_slot_else_number() -> None:
    assert PART.name == "ABCD-local"
    assert dataclasses.replace(PART, local_name="").name == "AA"
    assert dataclasses.replace(PART, local_name="", slot=None).name == "ABCD"


def test_a_uid_is_16_digits_and_no_uid_is_empty() -> None:
    assert uid_text(bytes.fromhex("00112233445566ff")) == "00112233445566ff"
    assert uid_text(b"") == ""
    assert uid_text(bytes(8)) == ""


@pytest.mark.parametrize(
    ("kind", "default", "text", "value"),
    [
        ("text", "", " a b ", " a b "),
        ("int", 0, " 7 ", 7),
        ("float", 0.0, " 7.5 ", 7.5),
        ("float", 0.0, "7", 7),
        ("bool", False, " Yes ", True),
    ],
)
def test_blanks_around_a_value_count_in_texts_only(kind: str, default: object, text: str, value: object) -> None:
    record = ValueRecord("p", kind, "", None, None, default, default, "library", "", 0, "")  # type: ignore[arg-type]
    assert record.read(text) == value


@pytest.mark.parametrize(("words", "value"), [(("true", "ON", "yes", "1"), True), (("false", "Off", "no", "0"), False)])
def test_a_truth_has_many_words(words: tuple[str, ...], value: bool) -> None:
    for text in words:
        record = ValueRecord("p", "bool", "", None, None, not value, not value, "library", "", 0, "")
        assert record.read(text) is value

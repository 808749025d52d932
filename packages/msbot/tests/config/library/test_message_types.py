"""Message types: those MsBOT brings, those of a file, and their mistakes."""

from pathlib import Path

import pytest

from msbot.config import FieldKind, MessageType, Scalar, load_library, standard_message_types
from msbot_xrce.errors import ConfigError

WIND = '[[type]]\nname = "Wind"\nfields = { speed = "float32", from = "uint16" }\nunits = { speed = "m/s" }\n'
PART = 'number = "W"\nname = "Vane"\n[[port]]\nname = "wind"\ndirection = "publish"\ntype = "Wind"\n'


def complaint(folder: Path, **texts: str) -> str:
    for name, text in texts.items():
        (folder / f"{name}.toml").write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_library(folder)
    return str(caught.value).replace(f"{folder}/", "")


def test_the_standard_types_are_few_and_have_fields() -> None:
    types = standard_message_types()
    assert types["Light"] == MessageType(
        "Light", {"lux": FieldKind.FLOAT32}, {"lux": "lx"}, "How bright it is", "msbot message types"
    )
    assert len(types) < 30
    assert all(message.fields and message.description for message in types.values())


def test_a_file_may_have_types_only_and_another_one_use_them(tmp_path: Path) -> None:
    (tmp_path / "a_types.toml").write_text(WIND)
    (tmp_path / "vane.toml").write_text(PART)
    (tmp_path / "z_types.toml").write_text(WIND)
    library = load_library(tmp_path)
    vane = library.get("W")
    assert vane is not None
    assert vane.ports[0].message == library.messages["Wind"]
    assert list(library.messages["Wind"].fields.items()) == [("speed", FieldKind.FLOAT32), ("from", FieldKind.UINT16)]


def test_an_unknown_type_names_file_line_and_key(tmp_path: Path) -> None:
    text = complaint(tmp_path, vane=PART.replace('"Wind"', '"Lihgt"'))
    assert text == (
        'vane.toml, line 6, port[0].type: there is no message type "Lihgt"; did you mean "Light"? '
        "Or declare it in a table [[type]]"
    )


def test_two_types_of_one_name_must_agree(tmp_path: Path) -> None:
    text = complaint(tmp_path, a=WIND, b=WIND.replace("uint16", "uint8"))
    assert 'b.toml, line 2, type[0].name: the message type "Wind" has other fields in a.toml' in text
    text = complaint(tmp_path, a=WIND, b=WIND.replace("Wind", "Light"))
    assert 'the message type "Light" has other fields in msbot message types' in text


WRONG = [
    (
        '"float32"',
        '"float"',
        'type[0].fields.speed: there is no kind of field "float"; did you mean "float64" or "float32"?',
    ),
    ("speed =", '"a b" =', 'type[0].fields.a b: "a b" cannot be the name of a field'),
    ("speed =", "_speed =", '"_speed" cannot be the name of a field'),
    ('{ speed = "m/s" }', '{ sped = "m/s" }', 'type[0].units.sped: the type has no field "sped"'),
    ('fields = { speed = "float32", from = "uint16" }', "fields = {}", "a message needs at least one field"),
    ('fields = { speed = "float32", from = "uint16" }', "", "type[0].fields: is missing"),
]


@pytest.mark.parametrize(("right", "wrong", "sentence"), WRONG)
def test_mistakes_in_a_type(tmp_path: Path, right: str, wrong: str, sentence: str) -> None:
    assert sentence in complaint(tmp_path, a=WIND.replace(right, wrong, 1))


FAULTS: list[tuple[FieldKind, Scalar, str | None]] = [
    (FieldKind.BOOL, True, None),
    (FieldKind.BOOL, 1, "must be true or false; it is the number 1"),
    (FieldKind.UINT8, 255, None),
    (FieldKind.UINT8, 256, "must be a whole number from 0 to 255; it is the number 256"),
    (FieldKind.INT16, -32768, None),
    (FieldKind.INT16, 1.5, "must be a whole number from -32768 to 32767; it is the number 1.5"),
    (FieldKind.UINT64, 2**64 - 1, None),
    (FieldKind.FLOAT32, 1, None),
    (FieldKind.FLOAT64, False, "must be a number; it is the truth value false"),
    (FieldKind.TEXT, "a", None),
    (FieldKind.TEXT, 1, "must be text in quotes; it is the number 1"),
]


@pytest.mark.parametrize(("kind", "value", "fault"), FAULTS)
def test_a_field_says_which_values_it_takes(kind: FieldKind, value: Scalar, fault: str | None) -> None:
    assert kind.fault(value) == fault


SIZES = [
    ("Light", 4),
    ("Switch", 1),
    ("Distance", 5),
    ("Stick", 9),
    ("Place", 21),
    ("Colour", 3),
    ("Text", None),
    ("HelloWorld", None),
]


@pytest.mark.parametrize(("name", "size"), SIZES)
def test_the_size_of_a_message_without_texts_is_known(name: str, size: int | None) -> None:
    assert standard_message_types()[name].size_bytes == size


def test_numbers_stand_at_multiples_of_their_size() -> None:
    fields = {"a": FieldKind.BOOL, "b": FieldKind.FLOAT64, "c": FieldKind.UINT8, "d": FieldKind.INT16}
    assert MessageType("Gaps", fields).size_bytes == 1 + 7 + 8 + 1 + 1 + 2


@pytest.mark.parametrize("kind", FieldKind)
def test_the_zero_of_a_field_fits_it(kind: FieldKind) -> None:
    assert kind.fault(kind.zero) is None

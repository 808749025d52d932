"""What a part says of itself: checked like a library file, refused with the reason, whatever the octets are."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.config import Direction, FieldKind, load_library, read_description
from msbot_xrce.errors import ConfigError

LIBRARY = load_library()
MINE = """number = "VANE-1"
name = "Vane"
[[port]]
name = "light"
direction = "publish"
type = "Light"
"""
WHOLE = """number = "VANE-1"
name = "Weather \\"vane\\""
category = "sensor"

[[port]]
name = "wind"
direction = "publish"
type = "Wind"

[[port]]
name = "brake"
direction = "subscribe"
type = "Level"
safe = { percent = 100.0 }

[[parameter]]
name = "gain"
type = "float"
default = 1.0
min = 0.1
max = 10
unit = "x"

[[type]]
name = "Wind"
fields = { speed = "float32" }
units = { speed = "m/s" }

[[type]]
name = "Level"
fields = { percent = "float32" }
"""


def test_what_is_right_is_written_anew_and_stands_by_itself() -> None:
    described = read_description("# any words \u2067 of a stranger\n" + WHOLE, "VANE-1", LIBRARY)
    part_type = described.part_type
    assert [(port.name, port.direction) for port in part_type.ports] == [
        ("wind", Direction.PUBLISH),
        ("brake", Direction.SUBSCRIBE),
    ]
    assert part_type.parameters[0].most == 10
    (wind,) = described.messages
    assert (wind.fields, wind.units) == ({"speed": FieldKind.FLOAT32}, {"speed": "m/s"})
    assert "stranger" not in described.toml
    assert described.toml == WHOLE.partition('\n[[type]]\nname = "Level"')[0]
    # A library that has it already knows the number; and its message is no contradiction for the next part.
    wider = LIBRARY.with_type(part_type, described.messages)
    with pytest.raises(ConfigError, match="the library knows VANE-1 already"):
        read_description(WHOLE, "VANE-1", wider)
    other = read_description(WHOLE.replace("VANE-1", "VANE-2"), "VANE-2", wider)
    assert "[[type]]" in other.toml


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is missing; add a line such as number"),
        ("number = 5", 'must be text in quotes, for example number = "ABCD"; it is the number 5'),
        ("[[[[[[[[[[[[", "nested deeper than 8 levels"),
        (MINE.replace("VANE-1", "VANE-2"), 'is "VANE-2", and the part has claimed as "VANE-1"'),
        (MINE.replace('"Light"', '"Lihgt"'), 'there is no message type "Lihgt"; did you mean "Light"'),
        (MINE + '[[type]]\nname = "Light"\nfields = { lux = "text" }', 'the message type "Light" has other fields in'),
        (MINE + '[driver]\nclass = "os:system"', "driver: a part may not say this of itself"),
        (MINE + "[[port]]\n" + MINE.partition("[[port]]\n")[2], 'there are two with the name "light"'),
        ('number = "VANE-1"\nname = "no ports"', "a part needs at least one port"),
        (MINE.replace("Vane", "Va\u202ene"), "contains a character that cannot be printed"),
        (MINE + '[[parameter]]\nname = ".stop"\ntype = "int"\ndefault = 1', 'must not contain "."'),
        (MINE + '[[parameter]]\nname = "a"\ntype = "int"\ndefault = 5\nmax = 4', "is 5; it must be at most 4"),
        (MINE + '[[parameter]]\nname = "a"\ntype = "float"\ndefault = inf', "must be a finite number"),
        (MINE + f'[[parameter]]\nname = "a"\ntype = "int"\ndefault = {2**63}', "more than 64 bits"),
    ],
)
def test_what_is_malformed_or_contradicts_is_refused_with_the_reason(text: str, words: str) -> None:
    with pytest.raises(ConfigError) as refused:
        read_description(text, "VANE-1", LIBRARY)
    assert words in str(refused.value)


@given(st.text(max_size=600))
def test_any_text_is_taken_or_refused_with_a_sentence(text: str) -> None:
    _taken_or_refused(text)


@given(
    st.lists(
        st.sampled_from(
            sorted(
                {
                    *WHOLE.split("\n"),
                    *MINE.split("\n"),
                    "[[port]]",
                    "name = 1",
                    "[port]",
                    "a.b.c = {}",
                    "x = [1, {y = 2}]",
                }
            )
        ),
        max_size=30,
    )
)
def test_lines_in_any_order_are_taken_or_refused_with_a_sentence(lines: list[str]) -> None:
    _taken_or_refused("\n".join(lines))


def _taken_or_refused(text: str) -> None:
    try:
        described = read_description(text, "VANE-1", LIBRARY)
    except ConfigError:
        return
    assert read_description(described.toml, "VANE-1", LIBRARY).part_type == described.part_type

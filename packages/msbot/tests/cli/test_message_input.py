"""What people may type for a message: the flow style of YAML, as `ros2 topic pub` takes it, and JSON."""

from __future__ import annotations

import json
import re
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot.cli.message_input import DEEPEST, Plain, read_message_text, typed_values, values_of
from msbot.config.library.message_types import type_from_words
from msbot.operations.manual_control import read_message
from msbot.part.messages.leaves import leaves_of
from msbot_xrce.errors import ConfigError

ARM = type_from_words(
    "Arm",
    {
        "Arm": {"mode": "Mode", "tip": "Vector", "joints": "float32[6]", "log": "text<=80"},
        "Mode": {"off": "0", "slow": "1", "fast": "2"},
        "Vector": {"x": "float32", "y": "float32", "z": "float32"},
    },
    {},
)


def test_the_example_of_the_reference_is_read() -> None:
    text = "{mode: slow, tip: {x: 1, y: 0, z: 0}, joints: [0, 0, 0, 0, 0, 0], log: ''}"
    values = typed_values([text])
    assert values == ["mode=slow", "tip.x=1", "tip.y=0", "tip.z=0", "joints=[0, 0, 0, 0, 0, 0]", "log="]
    message = read_message("arm", ARM, values)
    assert leaves_of(message)["mode"] == "slow"
    assert leaves_of(message)["joints"] == "[0, 0, 0, 0, 0, 0]"
    short = typed_values(["{mode: slow, tip: {x: 1}, joints: [1,2,3], log: ''}"])
    with pytest.raises(ConfigError, match=r"arm needs a value for tip\.y, tip\.z; it takes mode \(Mode\)"):
        read_message("arm", ARM, short)


def test_values_of_every_form() -> None:
    for text, values in {
        "{}": [],
        "{a: 1,}": ["a=1"],
        "{a:1,b :-2.5e3}": ["a=1", "b=-2.5e3"],
        " { a : yes , b : [ ] } ": ["a=yes", "b=[]"],
        "{a: [1, -2, 3.5, .5, 1e3, 0x10, true, slow, '7', \"x\"]}": [
            'a=[1, -2, 3.5, 0.5, 1000.0, 16, true, "slow", "7", "x"]'
        ],
        "{lamps: [{red: 1, green: 2, blue: 3}, [4, 5, 6]]}": ['lamps=[{"red": 1, "green": 2, "blue": 3}, [4, 5, 6]]'],
        "{text: it's a b, t2: 'it''s, {so}', t3: \"a\\tb\\u00e9\"}": ["text=it's a b", "t2=it's, {so}", "t3=a\tbé"],
        '{"a": {"b": {"c": "\\ud83d\\ude00"}}}': ["a.b.c=\U0001f600"],
        "{url: http://x/y?z=1, at: 12:30}": ["url=http://x/y?z=1", "at=12:30"],
    }.items():
        assert values_of(text) == values


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{on", "the name of a field and a colon are missing, at character 2"),
        ("{on}", "the name of a field and a colon are missing"),
        ("{a: {b: 1}}x", "the message has ended before, at character 12"),
        ("{a: 1", "a } or a comma is missing, at the end"),
        ("{a: [1, 2}", "a ] or a comma is missing, at character 10"),
        ("{a: }", "a value is missing; an empty text is ''"),
        ("{a: null}", "a value is missing"),
        ("{a: 1, a: 2}", "a stands twice"),
        ("{a: 'x}", "the closing ' is missing behind this one, at character 5"),
        ("{a: b: c}", "write b: c in quotes"),
        ("{a: !!python/object x}", "write !!python/object x in quotes"),
        ("{a: *b}", "write *b in quotes"),
        ("{a: b #c}", "write b #c in quotes"),
        ('{a: "\\q"}', r"\\q means nothing in a text; a backslash is \\"),
        ('{a: "\\ud83d"}', "half of a letter stands alone"),
        ("{a: 'x\ny'}", "a text with a line break stands in double quotes, with \\n in it"),
        ("{,}", "the name of a field and a colon are missing"),
        ("{a: " + "[" * DEEPEST + "1", f"more than {DEEPEST} brackets are inside each other"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(text: str, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        values_of(text)
    assert words.replace("\\\\", "\\") in str(caught.value).replace("\\\\", "\\")
    assert "write {field: value, field: value}" in str(caught.value)


def test_values_beside_a_whole_message_are_refused() -> None:
    with pytest.raises(ConfigError, match="is a whole message: write it alone, in quotes"):
        typed_values(["{a: 1}", "2"])
    assert typed_values(["percent: 40"], ["percent"]) == ["percent=40"]  # as `ros2 topic pub` takes it, too
    assert typed_values(["tip: {x: 1}"], ["tip"]) == ["tip.x=1"]
    assert typed_values(["message: hello, world"], ["message"]) == ["message=hello, world"]
    assert typed_values(["Note: hello"], ["text"]) == ["Note: hello"]


NAMES = st.from_regex(r"[a-z][a-z0-9_]{0,6}", fullmatch=True).filter(
    lambda name: name not in ("y", "n", "on", "off", "yes", "no", "true", "false", "null")
)
SCALARS = st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=12)
TREES = st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(NAMES, inner, max_size=3), max_leaves=12
)
MESSAGES = st.dictionaries(NAMES, TREES, max_size=4)


def plain(value: object) -> object:
    """What JSON makes of it, with the words that this reader leaves to the field."""
    if isinstance(value, Plain):
        return json.loads(value)
    if isinstance(value, list):
        return [plain(one) for one in value]
    return {name: plain(one) for name, one in value.items()} if isinstance(value, dict) else value


@given(MESSAGES, st.booleans())
def test_json_is_read_as_json(message: dict[str, Any], is_ascii: bool) -> None:
    assert plain(read_message_text(json.dumps(message, ensure_ascii=is_ascii))) == message


BREAKS = re.compile("[\n\r\x85\u2028\u2029]")
"""Where YAML folds lines."""


def is_on_one_line(message: object) -> bool:
    return BREAKS.search(json.dumps(message, ensure_ascii=False).replace("\\n", "\n").replace("\\r", "\r")) is None


@given(MESSAGES.filter(is_on_one_line))
def test_what_yaml_writes_is_read_as_yaml_reads_it(message: dict[str, Any]) -> None:
    yaml = pytest.importorskip("yaml", reason="PyYAML writes what is read")
    text = yaml.safe_dump(message, default_flow_style=True, width=10_000, allow_unicode=True, sort_keys=False)
    assert as_text(read_message_text(text.strip())) == as_text(message)


NUMBER = re.compile(r"[-+]?[0-9]+(\.[0-9]*)?(e[-+]?[0-9]+)?", re.ASCII)


def as_text(value: object) -> object:
    """Numbers and truth values as texts: which of them a word is, the field says."""
    if isinstance(value, dict):
        return {name: as_text(one) for name, one in value.items()}
    if isinstance(value, list):
        return [as_text(one) for one in value]
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return float(value) if NUMBER.fullmatch(value) else str(value)
    return float(value) if isinstance(value, int | float) else value


@given(st.text("{}[]:,'\"\\ -#ab1.\n", max_size=30))
def test_any_text_is_a_message_or_one_sentence(text: str) -> None:
    yaml = pytest.importorskip("yaml", reason="PyYAML reads what is read")
    found = theirs = None
    with suppress(ConfigError):
        found = read_message_text(text)
    with suppress(yaml.YAMLError):  # `{a:[1]}`: a blank is missing behind the colon
        theirs = yaml.safe_load(text)
    if found is not None and theirs is not None and not has_glued_names(text):
        assert set(found) == {str(name) for name in theirs}


def has_glued_names(text: str) -> bool:
    """Whether a plain name stands directly before its value, where YAML takes both for one name."""
    return any(one.isalnum() for one in text) and ":" in text.replace(": ", "")


WORDS = type_from_words("Words", {"Words": {"label": "text"}}, {})
TWO = type_from_words("Two", {"Two": {"value": "float32", "label": "text"}}, {})


@pytest.mark.parametrize(
    ("kind", "values", "words"),
    [
        (WORDS, ["lable=x"], "p has no field 'lable' (a text is written label=lable=x); did you mean label?"),
        (WORDS, ["zzz=x"], "p has no field 'zzz' (a text is written label=zzz=x); there are label"),
        (TWO, ["valu=3", "x"], "p has no field 'valu'; did you mean value?"),
        (TWO, ["1", "lable=x"], "p has no field 'lable' (a text is written label=lable=x); did you mean label"),
        (TWO, ["label=x", "y"], "p has two values for label"),
        (TWO, ["1", "x", "y"], "p takes 2 values, not 3: value (float32), label (text)"),
    ],
)
def test_a_misspelt_field_is_no_text(kind: Any, values: list[str], words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read_message("p", kind, values)
    assert str(caught.value).startswith(words)


def test_texts_with_a_sign_of_equality() -> None:
    for values, text in (
        (["label=a=b"], "a=b"),
        (["speed", "=", "5"], "speed = 5"),
        (["2 + 2 = 4"], "2 + 2 = 4"),
        (["https://x.org/?a=1"], "https://x.org/?a=1"),
        (["label=hello", "world"], "hello world"),
        (["hello", "world"], "hello world"),
    ):
        assert leaves_of(read_message("p", WORDS, values)) == {"label": text}

"""The line of every key."""

import json
import string
import tomllib
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from msbot_agent.toml.line_numbers import key_lines
from msbot_agent.toml.problems import KeyPath

TEXT = (
    """\
# a comment with [brackets] and "quotes
title = "a # no comment" # a comment

[robot]
name = "x"
"quoted.key" = 'its'
a.b . 'c' = 1

[[slot]]
"""
    'name = """\n'
    "many\n"
    '[lines] \\"\\"" ""'
    '"""\n'
    """\
list = [
  1, # one
  [2,
   3],
  { x = 1, y.z = "}" },
]

[slot.settings]
when = 1979-05-27 07:32:00
[[slot]]
name = '''a'''''
[slot.settings]
when = 1
[[slot.wire]]
n = 1
[[slot.wire]]
n = 2
[deep."er".down]
k = {}
e = []"""
)

EXPECTED: dict[KeyPath, int] = {
    ("title",): 2,
    ("robot",): 4,
    ("robot", "name"): 5,
    ("robot", "quoted.key"): 6,
    ("robot", "a"): 7,
    ("robot", "a", "b"): 7,
    ("robot", "a", "b", "c"): 7,
    ("slot",): 9,
    ("slot", 0): 9,
    ("slot", 0, "name"): 10,
    ("slot", 0, "list"): 13,
    ("slot", 0, "list", 0): 14,
    ("slot", 0, "list", 1): 15,
    ("slot", 0, "list", 1, 0): 15,
    ("slot", 0, "list", 1, 1): 16,
    ("slot", 0, "list", 2): 17,
    ("slot", 0, "list", 2, "x"): 17,
    ("slot", 0, "list", 2, "y"): 17,
    ("slot", 0, "list", 2, "y", "z"): 17,
    ("slot", 0, "settings"): 20,
    ("slot", 0, "settings", "when"): 21,
    ("slot", 1): 22,
    ("slot", 1, "name"): 23,
    ("slot", 1, "settings"): 24,
    ("slot", 1, "settings", "when"): 25,
    ("slot", 1, "wire"): 26,
    ("slot", 1, "wire", 0): 26,
    ("slot", 1, "wire", 0, "n"): 27,
    ("slot", 1, "wire", 1): 28,
    ("slot", 1, "wire", 1, "n"): 29,
    ("deep",): 30,
    ("deep", "er"): 30,
    ("deep", "er", "down"): 30,
    ("deep", "er", "down", "k"): 31,
    ("deep", "er", "down", "e"): 32,
}


def test_every_kind_of_key_is_found() -> None:
    tomllib.loads(TEXT)
    assert key_lines(TEXT) == EXPECTED


def test_windows_line_ends_count_once() -> None:
    assert key_lines("a = 1\r\n\r\nb = 2\r\n") == {("a",): 1, ("b",): 3}


@pytest.mark.parametrize("text", ["", "\n\n", "# only a comment", "   "])
def test_a_text_without_keys_has_no_lines(text: str) -> None:
    assert key_lines(text) == {}


KEYS = st.text(string.ascii_letters + string.digits + '-_ ."#[]=\\é', min_size=1, max_size=6)
LEAVES = st.one_of(
    st.booleans(), st.integers(-99, 99), st.text(string.printable + "é", max_size=8), st.floats(-9, 9, width=16)
)
VALUES = st.recursive(
    LEAVES,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=6,
)


def _toml_value(value: object) -> str:
    match value:
        case dict():
            return "{" + ", ".join(f"{json.dumps(key)} = {_toml_value(item)}" for key, item in value.items()) + "}"
        case list():
            return "[ # comment ]\n" + ",\n".join(_toml_value(item) for item in value) + "]"
        case bool() | str():
            return json.dumps(value).replace("\x7f", "\\u007f")
        case _:
            return repr(value)


def _paths(value: object, path: KeyPath) -> Iterator[KeyPath]:
    yield path
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _paths(item, (*path, key))
    elif isinstance(value, list):
        for position, item in enumerate(value):
            yield from _paths(item, (*path, position))


@given(st.dictionaries(KEYS, st.dictionaries(KEYS, VALUES, max_size=3), max_size=3))
def test_every_path_of_any_text_has_a_line_with_its_key(tables: dict[str, dict[str, object]]) -> None:
    lines = []
    for name, table in tables.items():
        lines.append(f"[{json.dumps(name)}]")
        lines.extend(f"{json.dumps(key)} = {_toml_value(value)} # comment" for key, value in table.items())
    text = "\n".join(lines)
    assert tomllib.loads(text) == tables
    found = key_lines(text)
    assert set(found) == {path for name, table in tables.items() for path in _paths(table, (name,))}
    by_line = text.split("\n")
    for path, line in found.items():
        if isinstance(path[-1], str):
            assert json.dumps(path[-1]) in by_line[line - 1]

"""Reading one table: every wrong value and the sentence it gets."""

from collections.abc import Callable

import pytest

from msbot_agent.toml.document import parse_document
from msbot_agent.toml.problems import Problems, toml_value_in_words
from msbot_agent.toml.table import Table


def _table(text: str) -> tuple[Table, Problems]:
    problems = Problems()
    document = parse_document(text, "file.toml", problems)
    assert document is not None
    return Table(document, problems, document.values), problems


def _name(table: Table) -> object:
    return table.name("key", "AA", forbidden=".")


def _text(table: Table) -> object:
    return table.text("key", "AA")


def _choice(table: Table) -> object:
    return table.choice("key", ["thesis", "fast"])


def _number(table: Table) -> object:
    return table.number("key", default=1.0, least=0.0, most=65.0, unit="s")


def _above(table: Table) -> object:
    return table.number("key", default=1.0, least=0.0, most=65.0, above=True)


def _whole(table: Table) -> object:
    return table.whole("key", default=3, least=1, most=255)


def _flag(table: Table) -> object:
    return table.flag("key", default=False)


def _names(table: Table) -> object:
    return table.names("key", "BB.in", required=True)


def _scalar(table: Table) -> object:
    return table.scalar("key")


def _scalars(table: Table) -> object:
    return table.scalars("key")


def _subtable(table: Table) -> object:
    return table.table("key", required=True).present_keys()


def _tables(table: Table) -> object:
    return [entry.present_keys() for entry in table.tables("key")]


Read = Callable[[Table], object]

RIGHT: list[tuple[Read, str, object]] = [
    (_name, 'key = "AA"', "AA"),
    (_name, f'key = "{"x" * 254}"', "x" * 254),
    (_text, 'key = ""', ""),
    (_text, "", ""),
    (_choice, 'key = "fast"', "fast"),
    (_number, "key = 2", 2.0),
    (_number, "key = 0.0", 0.0),
    (_number, "", 1.0),
    (_above, "key = 65", 65.0),
    (_whole, "key = 255", 255),
    (_whole, "", 3),
    (_flag, "key = true", True),
    (_flag, "", False),
    (_names, 'key = ["a", "b"]', ["a", "b"]),
    (_names, "key = []", []),
    (_scalar, "key = 1.5", 1.5),
    (_scalar, "", None),
    (_scalars, "key = {a = 1, b = true, c = 'x'}", {"a": 1, "b": True, "c": "x"}),
    (_scalars, "", {}),
    (_subtable, "[key]", []),
    (_subtable, "[key]\na = 1", ["a"]),
    (_tables, "[[key]]\na = 1\n[[key]]", [["a"], []]),
    (_tables, "", []),
]


@pytest.mark.parametrize(("read", "text", "value"), RIGHT)
def test_a_right_value_is_read_without_a_word(read: Read, text: str, value: object) -> None:
    table, problems = _table(text)
    assert read(table) == value
    problems.raise_if_any()


WRONG: list[tuple[Read, str, str]] = [
    (_name, "", 'key: is missing; add a line such as key = "AA"'),
    (_name, "key = 5", 'line 1, key: must be text in quotes, for example key = "AA"; it is the number 5'),
    (_name, 'key = ""', 'line 1, key: must not be empty; write for example key = "AA"'),
    (_name, 'key = "  "', 'line 1, key: must not be empty; write for example key = "AA"'),
    (_name, 'key = " AA"', 'line 1, key: " AA" has blanks at its ends; write key = "AA"'),
    (_name, 'key = "A.A"', 'line 1, key: "A.A" must not contain "."; use for example "_" in its place'),
    (_name, r'key = "A\u0000A"', r"line 1, key: 'A\x00A' contains a character that cannot be printed; remove it"),
    (_name, f'key = "{"x" * 255}"', f'line 1, key: "{"x" * 20}..." is 255 bytes long; shorten it to 254'),
    (_text, "key = []", 'line 1, key: must be text in quotes, for example key = "AA"; it is a list'),
    (_text, f'key = "{"ä" * 128}"', f'line 1, key: "{"ä" * 20}..." is 256 bytes long; shorten it to 254'),
    (_choice, "", 'key: is missing; add a line such as key = "thesis"'),
    (_choice, "key = 1", 'line 1, key: must be text in quotes, for example key = "thesis"; it is the number 1'),
    (_choice, 'key = "fsat"', 'line 1, key: "fsat" is none of "thesis", "fast"; did you mean "fast"?'),
    (_number, "key = '1'", 'line 1, key: must be a number, for example key = 1; it is the text "1"'),
    (_number, "key = true", "line 1, key: must be a number, for example key = 1; it is the truth value true"),
    (_number, "key = -1", "line 1, key: is -1; it must be 0 to 65 s"),
    (_number, "key = 65.5", "line 1, key: is 65.5; it must be 0 to 65 s"),
    (_number, "key = nan", "line 1, key: is nan; it must be 0 to 65 s"),
    (_number, "key = inf", "line 1, key: is inf; it must be 0 to 65 s"),
    (_above, "key = 0", "line 1, key: is 0; it must be more than 0 to 65"),
    (_whole, "key = 1.5", "line 1, key: must be a whole number, for example key = 3; it is the number 1.5"),
    (_whole, "key = 0", "line 1, key: is 0; it must be 1 to 255"),
    (_whole, "key = false", "line 1, key: must be a whole number, for example key = 3; it is the truth value false"),
    (_flag, "key = 'yes'", 'line 1, key: must be true or false, without quotes; it is the text "yes"'),
    (_names, "", 'key: is missing; add a line such as key = ["BB.in"]'),
    (_names, 'key = "BB.in"', 'line 1, key: must be a list, for example key = ["BB.in"]; it is the text "BB.in"'),
    (_names, "key = ['a',\n5]", 'line 2, key[1]: must be text in quotes, for example "BB.in"; it is the number 5'),
    (_names, "key = ['']", 'line 1, key[0]: must be text in quotes, for example "BB.in"; it is an empty text'),
    (
        _scalar,
        "key = 2021-04-08",
        "line 1, key: must be a number, true, false or a text; it is the date or time 2021-04-08 without quotes",
    ),
    (_scalars, "key = 5", "line 1, key: must be a table that begins with [key]; it is the number 5"),
    (_scalars, "key = {a = []}", "line 1, key.a: must be a number, true, false or a text; it is a list"),
    (_subtable, "", "key: is missing; add a table that begins with [key]"),
    (_subtable, "[[key]]", "line 1, key: must be a table that begins with [key]; it is a list"),
    (_tables, "[key]", "line 1, key: must begin with two brackets, [[key]], once for each; it is a table"),
    (_tables, "key = [1]", "line 1, key[0]: must be a table that begins with [[key]]; it is the number 1"),
]


@pytest.mark.parametrize(("read", "text", "sentence"), WRONG)
def test_a_wrong_value_is_one_sentence_with_the_remedy(read: Read, text: str, sentence: str) -> None:
    table, problems = _table(text)
    read(table)
    assert [str(problem) for problem in problems.found] == [f"file.toml, {sentence}"]


def test_a_key_that_nobody_asked_for_is_told_with_the_nearest_one() -> None:
    table, problems = _table("naem = 1\nzzz = 2")
    table.text("name", "AA")
    table.finish()
    assert [str(problem) for problem in problems.found] == [
        'file.toml, line 1, naem: there is no such key here; did you mean "name"?',
        'file.toml, line 2, zzz: there is no such key here; known: "name"',
    ]


def test_a_table_that_takes_nothing_says_remove_it() -> None:
    table, problems = _table("a = 1")
    table.finish()
    assert str(problems.found[0]) == "file.toml, line 1, a: there is no such key here; remove it"


def test_a_table_knows_whether_it_is_there() -> None:
    table, _ = _table("[here]")
    assert table.table("here").is_there
    assert not table.table("not_here").is_there


def test_kinds_in_words() -> None:
    assert toml_value_in_words({}) == "a table"
    assert toml_value_in_words("x" * 99) == f'the text "{"x" * 40}"'

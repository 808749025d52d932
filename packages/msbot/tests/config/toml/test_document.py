"""Reading and parsing a file: every way it can fail, with the sentence a person gets."""

from pathlib import Path

import pytest

from msbot_agent.toml.document import MOST_BYTES, Document, parse_document, read_document
from msbot_agent.toml.problems import FileLocation, Problems


def _read(path: Path) -> str:
    problems = Problems()
    assert read_document(path, problems, if_missing="write one") is None
    (problem,) = problems.found
    return str(problem)


def _parse(text: str) -> str:
    problems = Problems()
    assert parse_document(text, "robot.toml", problems) is None
    (problem,) = problems.found
    return str(problem)


def test_a_good_file_becomes_values_and_lines(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text("\ufeff[robot]\nname = 'Ä'\n", encoding="utf-8")
    document = read_document(path, Problems())
    assert document == Document(str(path), {"robot": {"name": "Ä"}}, "[robot]\nname = 'Ä'\n")
    assert document.lines == {("robot",): 1, ("robot", "name"): 2}
    assert document.location(("robot", "name")) == FileLocation(str(path), 2, ("robot", "name"))


def test_a_missing_key_is_placed_at_its_table() -> None:
    document = parse_document("\n[robot]\n", "robot.toml", Problems())
    assert document is not None
    assert str(document.location(("robot", "version"))) == "robot.toml, line 2, robot.version"
    assert str(document.location(("timing",))) == "robot.toml, timing"


def test_a_missing_file(tmp_path: Path) -> None:
    assert _read(tmp_path / "no.toml") == f"{tmp_path}/no.toml: there is no such file; write one"


def test_a_directory(tmp_path: Path) -> None:
    assert _read(tmp_path) == f"{tmp_path}: is a directory; name a file in it, for example {tmp_path}/robot.toml"


def test_no_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("msbot_agent.toml.document.open_input_file", refuse)
    path = tmp_path / "robot.toml"
    assert _read(path) == f"{path}: no permission to read it; try `chmod u+r {path}`"


def test_a_name_that_is_too_long_for_the_system(tmp_path: Path) -> None:
    path = tmp_path / ("x" * 300)
    assert _read(path) == f"{path}: cannot be read (File name too long); name another file"


def test_a_name_that_no_system_takes() -> None:
    assert _read(Path("a\0b")).endswith("cannot be read (no file can have that name); name another file")


def test_a_file_that_is_not_utf_8(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_bytes(b"[robot]\nname = 'M\xfcller'\n")
    assert _read(path) == f"{path}, line 2: byte 0xFC is not UTF-8; save the file as UTF-8 in your editor"


def test_a_file_that_is_much_too_large(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_bytes(b"#" * (MOST_BYTES + 1))
    assert _read(path) == f"{path}: is larger than 256,000 bytes; no file of this kind is: name another"


SYNTAX = [
    ("name", "line 1", "at the end of the file: a key needs an equals sign", None),
    ("name 5", "line 1", "column 6: a key needs an equals sign", "1 | name 5"),
    ("[robot]\nname = AA", "line 2", "column 8: this is not a value; text needs quotes", "2 | name = AA"),
    ("released = 8-4-2021", "line 1", "something is left behind the value", "1 | released = 8-4-2021"),
    ("a = 1\na = 2", "line 2", "this key is there twice in one table; keep one of them", None),
    ("a = {b = 1, b = 2}", "line 1", "this key is there twice in one table", None),
    ("[a]\n[a]", "line 2", "this table is there twice; for several of a kind write [[slot]]", "2 | [a]"),
    ("a = {b = 1}\n[a.c]", "line 2", "this table is there twice", None),
    ("a = {}\na.c = 1", "line 2", "this table was completed before", None),
    ("[robot\nname = 1", "line 1", "a bracket ] is missing behind the table's name", "1 | [robot"),
    ("a = [1 2]", "line 1", "a list is not closed; put a comma", None),
    ("a = {b = 1", "", "a table in braces is not closed", None),
    ('a = "x', "", "a text is not closed; put a quote at its end", None),
    ('a = "x\nb = 1', "line 1", "a text is not closed on its line", None),
    ("a = 'x\nb = 'y'", "line 1", "a text is not closed on its line", None),
    ("a = 'x", "", "a text is not closed; put a quote at its end", None),
    ("a = '''x", "", "a text is not closed; put a quote at its end", None),
    ('a = """x', "", "a text is not closed", None),
    ("[[a]\nb = 1", "line 1", "a bracket ] is missing", "1 | [[a]"),
    ('a = "C:\\path"', "line 1", "a backslash in a text must be doubled", None),
    ("a = 'x\x01'", "line 1", "this character is not allowed here; remove it", "1 | a = 'x?'"),
    ("= 1", "line 1", "this line is neither key = value nor [table]", None),
    ("[]", "line 1", "a key is missing or has no plain letters", None),
    ("a = 2021-02-30", "line 1", "this is not a date; put quotes around it", None),
]


@pytest.mark.parametrize(("text", "line", "words", "excerpt"), SYNTAX, ids=[case[0][:12] for case in SYNTAX])
def test_broken_toml_is_explained_in_words(text: str, line: str, words: str, excerpt: str | None) -> None:
    sentence = _parse(text)
    assert sentence.startswith("robot.toml, line ")
    assert line in sentence
    assert words in sentence
    assert excerpt is None or sentence.endswith(f"\n    {excerpt}")


def test_the_end_of_the_file_is_a_place_too() -> None:
    assert _parse("a = 1\nb =") == (
        'robot.toml, line 2: at the end of the file: this is not a value; text needs quotes, as in name = "AA"'
    )


def test_an_unknown_complaint_of_the_parser_is_passed_on() -> None:
    assert "this is not TOML (" in _parse('a = "\\ud800"')
    assert "see https://toml.io" in _parse('a = "\\ud800"')


def test_nesting_without_end() -> None:
    assert _parse("a = " + "[" * 100_000) == (
        "robot.toml, line 1: lists, tables or keys are nested deeper than 8 levels; a few are enough"
    )


def test_a_number_without_end() -> None:
    assert _parse("a = " + "9" * 5000).startswith("robot.toml: a number in it cannot be read (")

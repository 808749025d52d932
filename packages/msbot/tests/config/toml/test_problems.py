"""How mistakes are gathered and told."""

import pytest

from msbot_agent.text.similar_names import nearest
from msbot_agent.toml.problems import FileLocation, Problems, path_words, suggestion
from msbot_xrce.errors import ConfigError


def test_a_place_names_file_line_and_path() -> None:
    assert str(FileLocation("robot.toml", 12, ("slot", 1, "part"))) == "robot.toml, line 12, slot[1].part"
    assert str(FileLocation("robot.toml")) == "robot.toml"


def test_a_path_reads_like_python() -> None:
    assert path_words(("slot", 0, "settings", "period_s")) == "slot[0].settings.period_s"


def test_nothing_found_raises_nothing() -> None:
    Problems().raise_if_any()


def test_one_problem_is_one_sentence() -> None:
    problems = Problems()
    problems.add(FileLocation("robot.toml", 3, ("robot",)), "is missing")
    with pytest.raises(ConfigError) as caught:
        problems.raise_if_any()
    assert str(caught.value) == "robot.toml, line 3, robot: is missing"


def test_several_problems_are_told_in_the_order_of_the_lines() -> None:
    problems = Problems()
    problems.add(FileLocation("robot.toml", 30), "second")
    problems.add(FileLocation("robot.toml", 4), "first")
    problems.add(FileLocation("lib.toml", 40), "of another file")
    with pytest.raises(ConfigError) as caught:
        problems.raise_if_any()
    assert str(caught.value).splitlines() == [
        "3 problems were found:",
        "  lib.toml, line 40: of another file",
        "  robot.toml, line 4: first",
        "  robot.toml, line 30: second",
    ]


def test_nearest_words_ignore_capitals() -> None:
    assert nearest("efgh", ["ABCD", "EFGH", "WXYZ"]) == ["EFGH"]
    assert nearest("qqqq", ["ABCD"]) == []
    assert nearest("aa", ["AA", "Aa", "aA", "aa"]) == ["AA", "Aa", "aA"]


@pytest.mark.parametrize(
    ("word", "known", "expected"),
    [
        ("EFGX", ["EFGH", "ABCD"], 'did you mean "EFGH"?'),
        ("part1", ["part2", "part3"], 'did you mean "part3" or "part2"?'),
        ("zzz", ["AA", "BB"], 'known: "AA", "BB"'),
        ("zzz", [], "nothing is known"),
    ],
)
def test_a_suggestion_says_what_would_be_right(word: str, known: list[str], expected: str) -> None:
    assert suggestion(word, known, none_known="nothing is known") == expected


def test_a_long_list_of_known_words_is_cut() -> None:
    words = suggestion("?", [f"{number:04}" for number in range(100)], none_known="")
    assert words.startswith('known: "0000", "0001"')
    assert words.endswith('"0011", ...')

"""Which type can stand in for which other, and what is said when that cannot be."""

from pathlib import Path

import pytest

from msbot.config import load_library
from msbot_xrce.errors import ConfigError

PORT = '[[port]]\nname = "p"\ndirection = "publish"\ntype = "Level"\n'


def complaint(folder: Path, **types: tuple[str, str]) -> str:
    """What is said about types, each with its `compatible_with` and its ports."""
    for number, (others, ports) in types.items():
        (folder / f"{number}.toml").write_text(
            f'number = "{number}"\nname = "{number}"\ncompatible_with = {others}\n{ports}'
        )
    with pytest.raises(ConfigError) as caught:
        load_library(folder)
    return str(caught.value).replace(f"{folder}/", "")


def test_a_circle_is_told_once_with_the_way_round(tmp_path: Path) -> None:
    text = complaint(tmp_path, A=('["B"]', ""), B=('["C"]', ""), C=('["A"]', ""), D=('["A"]', ""))
    assert text == (
        "A.toml, line 3, compatible_with: goes round in a circle: A -> B -> C -> A; "
        "of two types that fit each other, let the newer name the older one"
    )


def test_a_type_that_fits_itself_is_a_circle(tmp_path: Path) -> None:
    assert "goes round in a circle: A -> A" in complaint(tmp_path, A=('["A"]', ""))


def test_a_number_that_is_not_there(tmp_path: Path) -> None:
    text = complaint(tmp_path, A=('["SG91"]', ""))
    assert text == ('A.toml, line 3, compatible_with[0]: the library has no part number "SG91"; did you mean "SG90"?')


@pytest.mark.parametrize("ports", ["", PORT.replace("Level", "Count"), PORT.replace("publish", "subscribe")])
def test_ports_that_are_missing_or_other(tmp_path: Path, ports: str) -> None:
    text = complaint(tmp_path, A=("[]", PORT), B=('["A"]', ports))
    assert 'B.toml, line 3, compatible_with[0]: cannot fill a slot for "A": that one has "p"' in text


def test_an_empty_number_is_told_once(tmp_path: Path) -> None:
    text = complaint(tmp_path, A=('[""]', ""))
    assert text.count("A.toml") == 1
    assert "compatible_with[0]: must be text in quotes" in text


def test_what_fits_is_right(tmp_path: Path) -> None:
    for number, others in (("A", "[]"), ("B", '["A"]'), ("C", '["B", "A"]')):
        (tmp_path / f"{number}.toml").write_text(f'number = "{number}"\nname = "n"\ncompatible_with = {others}\n{PORT}')
    c = load_library(tmp_path).get("C")
    assert c is not None
    assert c.compatible_with == ("B", "A")

"""Roll-outs are written down as they are made, so that they can be taken back."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from msbot.errors import ConfigError
from msbot.school.rollout import MOST_ROLLOUTS, RolledOut, RollOutBook


def test_roll_outs_are_remembered_as_they_are_made_and_not_for_ever(tmp_path: Path) -> None:
    book = RollOutBook(tmp_path)
    assert book.last() is None
    for number in range(MOST_ROLLOUTS + 5):
        written = book.begin(f"{number}.toml")
        written(RolledOut("R", "1", "robot.db", number))
    one, two = RolledOut("R", "1", "robot.db", number), RolledOut("R", "2", "robot.db", 9)
    written(two)
    assert len(json.loads((tmp_path / "rollouts.json").read_text())) == MOST_ROLLOUTS
    assert (book.last() or ("", 0, []))[2] == [one, two]
    book.taken_back([one])
    assert (book.last() or ("", 0, []))[2] == [two]
    book.taken_back([two])
    assert (book.last() or ("", 0, []))[0] == f"{number - 1}.toml"
    (tmp_path / "rollouts.json").write_text('[{"at": 1}]')
    with pytest.raises(ConfigError, match="move it away"):
        book.last()

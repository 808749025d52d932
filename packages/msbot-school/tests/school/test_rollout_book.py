"""Roll-outs are written down as they are made, so that they can be taken back."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from msbot_school.classroom.rollout_run import MOST_ROLLOUTS, RolledOutChange, RollOutLog
from msbot_xrce.errors import ConfigError


def test_roll_outs_are_remembered_as_they_are_made_and_not_for_ever(tmp_path: Path) -> None:
    book = RollOutLog(tmp_path)
    assert book.last() is None
    for number in range(MOST_ROLLOUTS + 5):
        at = book.begin(f"{number}.toml")
        book.note(at, RolledOutChange("R", "1", "robot.db", number))
    one, two = RolledOutChange("R", "1", "robot.db", number), RolledOutChange("R", "2", "robot.db", 9)
    book.note(at, two)
    entries = json.loads((tmp_path / "rollouts.json").read_text())
    assert len({entry["at"] for entry in entries}) == MOST_ROLLOUTS
    last = book.last()
    assert last is not None
    assert (last.at, last.done) == (at, (one, two))
    book.taken_back(at, [one])
    last = book.last()
    assert last is not None
    assert last.done == (two,)
    book.taken_back(at, [two])
    last = book.last()
    assert last is not None
    assert last.blueprint == f"{number - 1}.toml"
    with pytest.raises(ConfigError, match="does not know this roll-out"):
        book.note(1.0, one)
    (tmp_path / "rollouts.json").write_text('[{"at": 1}]')
    with pytest.raises(ConfigError, match="move it away"):
        book.last()


def test_two_roll_outs_at_the_same_time_lose_nothing_of_each_other(tmp_path: Path) -> None:
    first, second = RollOutLog(tmp_path), RollOutLog(tmp_path)
    ats = [first.begin("a.toml"), second.begin("b.toml")]
    assert ats[0] != ats[1]
    with ThreadPoolExecutor(4) as threads:
        for edit in range(20):
            for book, at in zip((first, second), ats, strict=True):
                threads.submit(book.note, at, RolledOutChange("R", "1", "robot.db", edit))
    entries = json.loads((tmp_path / "rollouts.json").read_text())
    assert [sorted(one["edit"] for one in entry["done"]) for entry in entries] == [list(range(20))] * 2

"""The trial of an update on the card: what its first start is judged by, and what comes of it."""

from __future__ import annotations

import contextlib
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest
from msbot_card import __main__ as units
from msbot_card.system import System
from msbot_card.updates import Versions


class Clock:
    """Nobody waits."""

    def __init__(self) -> None:
        self.now = 0.0

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


class Card(System):
    """A card with an update on trial.

    Args:
        root: its files.
        in_force: whether the update is where MsBOT is.
        ends: how often the master has ended when it is asked, from then on.
    """

    def __init__(self, root: Path, *, in_force: bool = True, ends: int = 0) -> None:
        super().__init__(root)
        (root / "data/card/versions/0.2.0").mkdir(parents=True)
        self.store._keep(Versions(current="0.2.0", trial=True, starts=1))
        self._in_force, self._ends = in_force, ends
        self.programs: list[tuple[str, ...]] = []

    @property
    def has_update_in_force(self) -> bool:
        return self._in_force

    def _run(self, *command: str, user: str | None = None, stdin: str = "") -> str | None:
        self.programs.append(command)
        return f"{self._ends}\n" if "NRestarts" in command else ""

    @property
    def restarts(self) -> bool:
        return ("systemctl", "--no-block", "reboot") in self.programs


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(units, "time", clock)
    return clock


def page_from(monkeypatch: pytest.MonkeyPatch, clock: Clock, at: float, status: int = 200) -> None:
    """There is a page from that time on."""

    @contextlib.contextmanager
    def urlopen(_: str, timeout: float) -> Iterator[SimpleNamespace]:
        if clock.now < at:
            raise ConnectionRefusedError
        yield SimpleNamespace(status=status)

    monkeypatch.setattr(urllib.request, "urlopen", urlopen)


def test_an_update_is_well_when_its_page_answers(tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    page_from(monkeypatch, clock, 200.0)
    card = Card(tmp_path, ends=1)
    units.trial(card)
    assert card.store.versions() == Versions(current="0.2.0", told="updated")
    assert not card.restarts
    assert 200.0 <= clock.now < 210.0


def test_an_update_without_a_page_goes_back_when_its_time_is_over(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    page_from(monkeypatch, clock, 1000.0)
    card = Card(tmp_path)
    units.trial(card)
    assert card.store.versions().back
    assert card.restarts
    assert units.TRIAL_S <= clock.now < units.TRIAL_S + 10.0


def test_an_emulated_computer_gives_an_update_more_time(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    page_from(monkeypatch, clock, 1000.0)
    monkeypatch.setenv(units.LONGER, "1800")
    card = Card(tmp_path)
    units.trial(card)
    assert card.store.versions().told == "updated"
    for odd in ("", "0", "-3", "1e3", "100000"):
        assert units.trial_s(odd) == units.TRIAL_S


def test_an_update_whose_master_ends_again_and_again_goes_back_at_once(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    page_from(monkeypatch, clock, 0.0)
    card = Card(tmp_path, ends=units.MOST_ENDS + 1)
    units.trial(card)
    assert card.store.versions().back
    assert card.restarts
    assert clock.now == 0.0


def test_an_update_that_is_not_in_force_is_not_judged_by_the_page_of_the_image(
    tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    page_from(monkeypatch, clock, 0.0)
    card = Card(tmp_path, in_force=False)
    units.trial(card)
    assert card.store.versions().back
    assert card.restarts


def test_without_an_update_there_is_no_trial(tmp_path: Path, clock: Clock) -> None:
    card = Card(tmp_path)
    card.store.end_trial(healthy=True)
    units.trial(card)
    assert card.programs == []
    assert clock.now == 0.0

"""Cuts of the power at each step of an update on the card, and of the way back: the next start finds a whole version,
and the database that belongs to it.

A cut is made where a folder or a file is about to change. What was written and not synced is lost then, or kept: both
are tried. Names change in the order in which they were changed, as on ext4.
"""

from __future__ import annotations

import os
import shutil
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from msbot_card.updates import UNFINISHED, Store, Versions

from tests.test_card_helper import PYTHON, needs_dpkg, package

CHANGES = frozenset({"os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.symlink", "os.chmod", "os.chown"})
MOST_STEPS = 400
OLD, NEWER, BROKEN = "0.1.0", "0.2.0", "0.3.0"


class PowerCut(BaseException):
    """It is dark: no `except` and no `finally` does anything any more."""


class Power:
    """Counts what changes in this thread, and cuts.

    Args:
        at: the number of the change that is not made any more.
    """

    now: Power | None = None

    def __init__(self, at: int) -> None:
        self._left, self.is_cut = at, False
        self._thread = threading.get_ident()
        self._opened: list[str] = []
        self._unsynced: set[int] = set()
        """Inodes."""

    def note(self, event: str, arguments: tuple[object, ...]) -> None:
        """An event of Python's audit (PEP 578)."""
        if threading.get_ident() != self._thread:
            return
        named = arguments[0] if event == "open" else None  # of one that is open already: its number
        writes = isinstance(named, str | os.PathLike) and int(str(arguments[2])) & (os.O_WRONLY | os.O_RDWR)
        if not writes and event not in CHANGES:
            return
        self._find_inodes()
        if self.is_cut or not self._left:
            self.is_cut = True
            raise PowerCut
        self._left -= 1
        if writes:
            self._opened.append(str(named))

    def fsync(self, descriptor: int) -> None:
        """In place of that of `os`."""
        self._find_inodes()
        self._unsynced.discard(os.fstat(descriptor).st_ino)

    def sync(self) -> None:
        """The same."""
        self._opened.clear()
        self._unsynced.clear()

    def lose(self, folder: Path) -> None:
        """Empty what was not synced."""
        for path in folder.rglob("*"):
            if path.is_file() and not path.is_symlink() and path.stat().st_ino in self._unsynced:
                os.truncate(path, 0)

    def _find_inodes(self) -> None:
        for name in self._opened:
            if os.path.exists(name):
                self._unsynced.add(os.stat(name).st_ino)
        self._opened.clear()


def _audit(event: str, arguments: tuple[object, ...]) -> None:
    if Power.now is not None and (event == "open" or event in CHANGES):
        Power.now.note(event, arguments)


@pytest.fixture(scope="module", autouse=True)
def _audited() -> None:
    sys.addaudithook(_audit)


Do = Callable[[Store], object]


class Card:
    """Folders of a card, made again for each cut.

    Args:
        kept: as they are before.
        folder: where they are tried.
        loses: whether a cut loses what was not synced.
    """

    def __init__(self, kept: Path, folder: Path, monkeypatch: pytest.MonkeyPatch, *, loses: bool) -> None:
        self._kept, self.folder, self._loses = kept, folder / "tried", loses
        self._monkeypatch = monkeypatch

    @property
    def store(self) -> Store:
        """As the next start has it."""
        return store_in(self.folder)

    @property
    def database(self) -> dict[str, str]:
        """The files beside the robot's database, by name."""
        return {path.name: path.read_text() for path in sorted((self.folder / "msbot").iterdir())}

    def after_cuts(self, do: Do) -> Iterator[int]:
        """Try it with a cut at each step; yields with what the cut has left, until it goes through without one."""
        for at in range(MOST_STEPS):
            shutil.rmtree(self.folder, ignore_errors=True)
            shutil.copytree(self._kept, self.folder, symlinks=True)
            if not self.cut(do, at):
                assert at > 3  # there was something to cut
                return
            yield at
        pytest.fail(f"it takes more than {MOST_STEPS} steps")

    def cut(self, do: Do, at: int) -> bool:
        """Do it with a cut at a step; returns whether it came to that."""
        power = Power(at)
        with self._monkeypatch.context() as patched:
            patched.setattr(os, "fsync", power.fsync)
            patched.setattr(os, "sync", power.sync)
            Power.now = power
            try:
                do(self.store)
            except PowerCut:
                pass
            finally:
                Power.now = None
        if power.is_cut and self._loses:
            power.lose(self.folder)
        return power.is_cut

    def need_tidy(self) -> None:
        """Nothing is left of what was being made."""
        assert [path.name for path in (self.folder / "card").glob(f"{UNFINISHED}*")] == []

    def need_whole(self, version: str) -> None:
        """A version's environment is all there."""
        found = self.store.place(version)
        assert (found / "bin/msbot").read_text() == version
        assert (found / "bin/python3").is_symlink()
        assert (found / "lib" / PYTHON / "site-packages").is_dir()


def store_in(folder: Path) -> Store:
    return Store(folder / "card", folder / "msbot/robot.db", PYTHON)


def write_database(folder: Path, words: str, journal: str = "") -> None:
    """As a master leaves it: with a journal, or without."""
    for end, text in (("", words), ("-wal", journal), ("-shm", journal and "shared")):
        path = folder / f"msbot/robot.db{end}"
        path.unlink(missing_ok=True)
        if text:
            path.write_text(text)


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("packages")
    return {version: package(folder, version) for version in (NEWER, BROKEN)}


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    """A card as it was flashed, with a database."""
    folder = tmp_path / "kept"
    for name in ("card", "msbot"):
        (folder / name).mkdir(parents=True)
    write_database(folder, "old", "of old")
    return folder


@pytest.fixture(params=[True, False], ids=["unsynced is lost", "unsynced is kept"])
def card(request: pytest.FixtureRequest, kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Card:
    return Card(kept, tmp_path, monkeypatch, loses=bool(request.param))


def updated(kept: Path, packages: dict[str, Path]) -> Store:
    """A card with an update that is well."""
    store = store_in(kept)
    store.take_in(packages[NEWER], OLD)
    store.begin()
    write_database(kept, "newer", "of newer")
    store.end_trial(healthy=True)
    return store


WITH_OLD = {"robot.db": "old", "robot.db-shm": "shared", "robot.db-wal": "of old"}
WITH_NEWER = {"robot.db": "newer", "robot.db-shm": "shared", "robot.db-wal": "of newer"}


def aside(version: str, files: dict[str, str]) -> dict[str, str]:
    """Files of a database that were set aside."""
    return {name.replace("robot.db", f"robot.db.of-{version}"): text for name, text in files.items()}


@needs_dpkg
@pytest.mark.promise("A cut of the power at any step of a card's update, or of its way back, leaves a whole version")
def test_a_cut_while_an_update_is_taken_in(card: Card, kept: Path, packages: dict[str, Path]) -> None:
    (kept / "card/versions/0.0.9/bin").mkdir(parents=True)  # nobody needs it any more
    came: set[str] = set()
    for _ in card.after_cuts(lambda store: store.take_in(packages[NEWER], OLD)):
        now = card.store.begin()
        came.add(now.current)
        if now.current:
            assert now == Versions(current=NEWER, trial=True, starts=1)
            card.need_whole(NEWER)
        else:
            assert now == Versions()
            card.store.take_in(packages[NEWER], OLD)  # and again
            card.need_whole(NEWER)
        assert card.database == WITH_OLD
        card.need_tidy()
    assert came == {"", NEWER}


@needs_dpkg
def test_a_cut_in_the_first_start_of_a_trial(card: Card, kept: Path, packages: dict[str, Path]) -> None:
    store_in(kept).take_in(packages[NEWER], OLD)
    for _ in card.after_cuts(Store.begin):
        now = card.store.begin()
        assert now.current == NEWER
        assert now.starts in (1, 2)  # at the very end it was counted already
        card.need_whole(NEWER)
        card.need_tidy()
        write_database(card.folder, "newer")
        card.store.end_trial(healthy=False)
        assert card.store.begin() == Versions(told="fell back")
        assert card.database == {**WITH_OLD, f"robot.db.of-{NEWER}": "newer"}


@needs_dpkg
def test_two_cuts_in_a_start_that_goes_back_by_itself(card: Card, kept: Path, packages: dict[str, Path]) -> None:
    store = updated(kept, packages)
    store.take_in(packages[BROKEN], OLD)
    store.begin()
    write_database(kept, "broken", "of broken")
    store.end_trial(healthy=False)
    first = 0
    for first in card.after_cuts(Store.begin):
        second = 0
        while card.cut(Store.begin, second):
            second += 3 + first % 3
        assert card.store.begin() == Versions(current=NEWER, told="fell back")
        card.need_whole(NEWER)
        card.need_tidy()
        broken = {"robot.db": "broken", "robot.db-shm": "shared", "robot.db-wal": "of broken"}
        assert card.database == {**WITH_NEWER, **aside(BROKEN, broken)}
    assert first > 8


@needs_dpkg
def test_a_cut_in_a_start_that_goes_back_to_the_image_again(card: Card, kept: Path, packages: dict[str, Path]) -> None:
    """What was set aside by an earlier way back makes room."""
    updated(kept, packages)
    for name, text in aside(NEWER, {"robot.db": "earlier", "robot.db-wal": "of earlier"}).items():
        (kept / "msbot" / name).write_text(text)
    store_in(kept).ask_back()
    for _ in card.after_cuts(Store.begin):
        assert card.store.begin() == Versions(told="went back")
        assert card.database == {**WITH_OLD, **aside(NEWER, WITH_NEWER)}
        # And the next update has the image's database again, not what the cut has left of a copy.
        card.store.take_in(packages[NEWER], OLD)
        card.store.begin()
        write_database(card.folder, "newer", "of newer")
        card.store.ask_back()
        assert card.store.begin() == Versions(told="fell back")
        assert card.database == {**WITH_OLD, **aside(NEWER, WITH_NEWER)}
        card.need_tidy()


@needs_dpkg
def test_a_copy_that_is_left_from_before_is_no_reason_to_change_the_database(
    kept: Path, packages: dict[str, Path]
) -> None:
    """An update that is given up before its first start has written nothing, and has copied nothing."""
    left = kept / "card/database-of-image"
    left.mkdir()
    (left / "robot.db").write_text("much older")
    store = store_in(kept)
    store.take_in(packages[NEWER], OLD)
    store.ask_back()
    assert store.begin() == Versions(told="fell back")
    assert (kept / "msbot/robot.db").read_text() == "old"


@needs_dpkg
def test_a_card_without_room_for_the_way_back_stays_with_its_version(
    kept: Path, packages: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    store = store_in(kept)
    store.take_in(packages[NEWER], OLD)
    monkeypatch.setattr(shutil, "copy2", full)
    assert store.begin() == Versions(told="fell back")
    assert store.begin() == Versions(told="fell back")
    assert not store.place(NEWER).exists()
    assert [path.name for path in (kept / "card").glob(f"{UNFINISHED}*")] == []

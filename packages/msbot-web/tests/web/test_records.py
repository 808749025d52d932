"""What the pages show of the database: journal, robots, blueprint, users, backups."""

from __future__ import annotations

import asyncio
import os
import sqlite3
import sys
import tempfile
import tracemalloc
from collections.abc import AsyncIterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from msbot.config import blueprint_toml
from msbot.operations.rights import Role
from msbot.registry import open_registry
from msbot.registry.maintenance import database_maintenance, waiting_restore
from msbot_web.access.sessions import Session
from msbot_web.access.users import User
from msbot_web.stored_data import RegistryUsers, robot_tiles
from tests.operations.stage import AA_IS_A_DIAL
from tests.web.rig import Rig, chunks, refusal, show


async def test_users_are_kept_with_role_and_tokens(tmp_path: Path) -> None:
    with open_registry(tmp_path / "robot.db") as registry:
        users = RegistryUsers(registry)
        assert registry.users.all() == []
        bob = User("bob", Role.STUDENT, "salt", (("desk", "abc"),))
        await users.keep_users([bob, User("Zoe", Role.VIEWER, "pepper")], "ada")
        found = await registry.storage.in_time(users.users)
        assert bob in [replace(user, since_ns=0) for user in found]
        assert {user.name for user in registry.users.all()} == {"bob", "Zoe"}
        promoted = User("bob", Role.TEACHER, "salt", ())
        await users.keep_users([promoted], "ada")
        found = await registry.storage.in_time(users.users)
        assert promoted in [replace(user, since_ns=0) for user in found]
        await users.remove_user("bob", "ada")
        assert [user.name for user in registry.users.all()] == ["Zoe"]


def test_the_journal_is_told_newest_first_with_its_evidence(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        rig.stage.registry.storage.flush()
        lines = await rig.service.journal(rig.session(Role.TEACHER), 100)
        assert [line.number for line in lines] == sorted((line.number for line in lines), reverse=True)
        entered = next(line for line in lines if line.part == "AA" and line.to_state == "active")
        assert (entered.slot, entered.from_state) == ("AA", "checking")
        assert entered.evidence
        assert len(await rig.service.journal(rig.session(Role.TEACHER), 2)) == 2
        assert {line.part for line in await rig.service.journal(rig.session(Role.TEACHER), 100, "AA")} == {"AA"}

    show(tmp_path, scene)


def test_the_class_view_counts_the_slots_that_are_held(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        rig.stage.registry.storage.flush()
        (tile,) = await rig.service.whole_class.robots()
        assert (tile.name, tile.here, tile.running, tile.slots, tile.active) == ("MSBOT_MASTER", True, True, 3, 3)
        assert tile.last_event
        rig.stage.pull("AA")
        await asyncio.sleep(7.0)
        rig.stage.registry.storage.flush()
        (tile,) = await rig.service.whole_class.robots()
        assert tile.active == 2
        assert tile.last_event.startswith("AA")
        (record,) = rig.stage.registry.robots.all()
        entry = rig.stage.registry.robots.journal(1, robot=record)[-1]
        (tile,) = await robot_tiles(rig.stage.registry, record, epoch_ns=lambda: entry.at_ns + 90 * 10**9)()
        assert tile.last_event_age_s == 90.0

    show(tmp_path, scene)


def test_a_blueprint_goes_out_is_compared_and_comes_in(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        teacher = rig.session(Role.TEACHER)
        text = await rig.service.blueprint()
        assert (await rig.service.blueprint_diff(teacher, text)).changes == []
        changed = text.replace("Light sensor, 5V", "<b>Dial</b>")
        (line,) = (await rig.service.blueprint_diff(teacher, changed)).changes
        assert "AA" in line
        assert await rig.service.blueprint() == text  # comparing changes nothing
        done = await rig.service.apply_blueprint(teacher, changed)
        assert done.words
        assert rig.views.slot("AA").description == "<b>Dial</b>"
        assert (await rig.service.edits(1))[0].who == "teacher"
        words = str(await refusal(lambda: rig.service.blueprint_diff(teacher, text.replace('"ABCD"', '"ABCX"'))))
        assert "ABCX" in words

    show(tmp_path, scene)


def test_what_was_set_by_hand_goes_out_with_a_remark(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        await rig.act(rig.session(Role.STUDENT), "set", slot="AA", name="period_s", value=0.5)
        text = await rig.service.blueprint()
        assert "0.5" in text
        (record,) = rig.stage.registry.robots.all()
        assert text == blueprint_toml(
            rig.stage.registry.robots.blueprint(record), rig.stage.registry.robots.made_by_hand(record)
        )

    show(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


async def whole(rig: Rig, session: Session) -> bytes:
    """A backup, all of it."""
    backup = await rig.service.backup(session)
    content = b"".join([piece async for piece in backup.octets])
    assert len(content) == backup.size
    return content


def test_a_backup_comes_back_with_the_next_start(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        ada = rig.session(Role.ADMINISTRATOR)
        content = await whole(rig, ada)
        assert content.startswith(b"SQLite format 3")
        assert "when the master restarts" in (await rig.service.restore(ada, chunks(content))).words
        assert rig.stage.registry.storage.flush()  # a slow disk stores the line later than who reads waits for it
        assert ("ada", "restore") in [(edit.who, edit.kind) for edit in await rig.service.edits(5)]
        assert "not used" in str(await refusal(lambda: rig.service.restore(ada, chunks(b"something else"))))

    show(tmp_path, scene)
    assert waiting_restore.bring_back_held(str(tmp_path / "robot.db")) is not None


def test_a_blueprint_that_costs_too_much_is_refused_and_the_robot_goes_on(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        teacher = rig.session(Role.TEACHER)
        for text in ("a." * 20_000 + "a = 1", "[[slot]]\n" * 6000):
            words = str(await refusal(lambda text=text: rig.service.blueprint_diff(teacher, text)))  # type: ignore[misc]
            assert "robot.toml" in words
            assert len(words) < 40_000
        present = await rig.service.blueprint()
        assert (await rig.service.blueprint_diff(teacher, present)).changes == []

    show(tmp_path, scene)


LARGE = 24 << 20


def test_a_large_backup_is_taken_in_pieces_and_the_robot_has_its_turn_after_each(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        ada = rig.session(Role.ADMINISTRATOR)
        large = tmp_path / "large.db"
        large.write_bytes(await whole(rig, ada))
        with closing(sqlite3.connect(large)) as database:
            database.execute("CREATE TABLE filling AS SELECT zeroblob(?) AS octets", [LARGE])
            database.execute("DROP TABLE filling")  # the file stays as large as it was
        turns = [0]

        async def beat() -> None:
            while True:
                turns[0] += 1
                await asyncio.sleep(0)

        async def pieces() -> AsyncIterator[bytes]:
            with large.open("rb") as file:
                while octets := file.read(1 << 20):
                    before = turns[0]
                    yield octets
                    assert turns[0] > before
            beating.cancel()  # what follows is another process' work

        beating = asyncio.create_task(beat())
        tracemalloc.start()
        try:
            await rig.service.restore(ada, pieces())
            _, most = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
        assert most < LARGE / 4
        assert (tmp_path / "robot.db.restore").stat().st_size > LARGE

    show(tmp_path, scene, parts=())


def test_a_large_backup_goes_out_in_pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def large(address: str, target: Path) -> int:
        rows = back_up(address, target)
        os.truncate(target, LARGE)
        return rows

    back_up = database_maintenance.back_up
    monkeypatch.setattr(database_maintenance, "back_up", large)

    async def scene(rig: Rig) -> None:
        tracemalloc.start()
        try:
            backup = await rig.service.backup(rig.session(Role.ADMINISTRATOR))
            size = 0
            async for piece in backup.octets:
                size += len(piece)
            _, most = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
        assert size == backup.size == LARGE
        assert most < LARGE / 4

    show(tmp_path, scene, parts=())


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux lists the open files of a process")
def test_a_download_that_is_broken_off_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))

    async def scene(rig: Rig) -> None:
        before = open_files()
        backup = await rig.service.backup(rig.session(Role.ADMINISTRATOR))
        await anext(backup.octets)
        assert open_files() == before + 1
        del backup  # as the web server does when the browser has gone
        assert open_files() == before

    show(tmp_path, scene, parts=())
    assert list(tmp_path.glob("msbot-backup-*")) == []


def open_files() -> int:
    """Files in the folder of the test that this process has open."""
    return sum("backup.db" in os.path.realpath(f"/proc/self/fd/{one}") for one in os.listdir("/proc/self/fd"))

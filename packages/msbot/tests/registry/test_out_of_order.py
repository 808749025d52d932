"""A robot whose database cannot be written any more: it goes on from memory, says so, and stores all of it later."""

import asyncio
import sqlite3
from pathlib import Path

import pytest
from sqlalchemy import Engine, event
from sqlalchemy.pool import ConnectionPoolEntry, PoolProxiedConnection

from msbot.operations.dispatch import InProcessOperations
from msbot.pnp import PartState
from tests.operations.stage import AA_IS_A_DIAL, Stage, play

FULL = "has no room: the disk is full; delete something"
READ_ONLY = "is read-only: allow writing to the file and its folder (`chmod u+w`), or choose another --db"


class Fault:
    """Something that is wrong with every connection to a database while `is_on`.

    The statements are SQLite's own means of behaving as on a full disk (no page more than there are), and as with a
    file that must not be written.
    """

    def __init__(self, engine: Engine, on: str, off: str) -> None:
        self.is_on = False
        self._statements = {True: on, False: off}
        event.listen(engine, "checkout", self._set)

    def _set(self, connection: sqlite3.Connection, _entry: ConnectionPoolEntry, _proxy: PoolProxiedConnection) -> None:
        connection.execute(self._statements[self.is_on])


FAULTS = {
    FULL: ("PRAGMA max_page_count = 1", "PRAGMA max_page_count = 1000000000"),
    READ_ONLY: ("PRAGMA query_only = ON", "PRAGMA query_only = OFF"),
}


@pytest.mark.parametrize("words", FAULTS)
def test_the_robot_goes_on_and_says_so(tmp_path: Path, words: str, caplog: pytest.LogCaptureFixture) -> None:
    database = tmp_path / "robot.db"

    async def scene(stage: Stage) -> None:
        registry, master = stage.registry, stage.master
        fault = Fault(registry.storage.engine, *FAULTS[words])
        assert stage.slot("one") == "AA"
        fault.is_on = True
        # Parts come and go as ever, a spare takes over, and a part gets its settings.
        stage.plug("spare", "DIAL")
        await asyncio.sleep(2.0)
        assert stage.state("spare") == "standby"
        stage.pull("one")
        await asyncio.sleep(8.0)
        assert stage.slot("spare") == "AA"
        assert float(stage.parts["spare"].settings["period_s"]) == 1.0
        for _ in range(300):  # there may be room in the last page
            for entry in stage.events:
                master.inventory._store.journal(entry)
            if not registry.storage.flush():
                break
        assert registry.storage.health.trouble is not None
        assert registry.storage.health.trouble.startswith(
            f"the database {database} {words}; changes kept in memory until it can"
        )
        assert any(message.endswith(f"{words}; until then changes are kept in memory") for message in caplog.messages)
        # What people want to change is refused, with the reason, and nothing is otherwise.
        refused = await stage.refusal(stage.do.set("AA", "period_s", "2", who="Ann"))
        assert words in refused
        assert await _period(stage.operations) == ("1.0", "library")
        assert words in await stage.refusal(stage.do.swap("BB", "spare", who="Ann")) or stage.slot("spare") == "AA"
        # Mended: everything is stored in order, and people can change things again.
        fault.is_on = False
        assert registry.storage.flush()
        assert registry.storage.health.trouble is None
        assert registry.storage.health.lost == 0
        assert caplog.messages[-1] == f"the database {database} can be written again"
        await stage.do.set("AA", "period_s", "2", who="Ann")
        assert await _period(stage.operations) == ("2.0", "hand")
        states = [entry.event.to_state for entry in registry.robots.journal(100_000, "spare")]
        assert PartState.STANDBY in states
        assert PartState.ACTIVE in states

    play(tmp_path, scene, AA_IS_A_DIAL, parts=("one=DIAL",))


async def _period(operations: InProcessOperations) -> tuple[str, str]:
    (value,) = await operations.settings.read("AA")
    return str(float(value.value)), value.origin

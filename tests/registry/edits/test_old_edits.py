"""What an older MsBOT has stored is read, shown and undone: a database written by the code of 0.1.0 at schema 4."""

import json
import sqlite3
from contextlib import closing
from functools import partial
from pathlib import Path

from msbot.pnp import SlotBinding
from msbot.registry import open_registry
from msbot.registry.edits.undo import undo
from msbot.registry.records import EditRecord

OLD = Path(__file__).parent / "old" / "schema4.sql"


def test_every_kind_of_edit_of_an_older_msbot_is_undone(path: Path) -> None:
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(OLD.read_text())
        # A setting was changed and taken back since the blueprint was applied: as if it had not been.
        (after,) = connection.execute("SELECT after FROM edits WHERE id = 7").fetchone()
        for row in json.loads(after)["robot"]["settings"]:
            then = (row["changed_ns"], row["who"], row["name"], row["origin"])
            connection.execute("UPDATE settings SET changed_ns = ?, who = ? WHERE name = ? AND origin = ?", then)
        connection.commit()
    with open_registry(path) as registry:
        (robot,) = registry.robots.all()
        edits = {edit.id: edit for edit in registry.edits.latest(robot)}
        assert [edit.kind for edit in edits.values()] == [
            "stop", "undo", "value", "apply", "bind", "bind", "block", "place", "place", "value",
        ]  # fmt: skip
        assert (edits[5].slots, edits[3].placed, edits[8].undone) == (("BB",), ((b"secondUI", "BB"),), True)

        def take_back(number: int) -> EditRecord:
            return registry.edits.make(robot, "Ann", partial(undo, number=number))

        description = registry.robots.blueprint(robot).slots[0].description
        assert description == "Sees the sun"
        assert take_back(7).words.startswith("edit 7 undone: the blueprint")
        assert registry.robots.blueprint(robot).slots[0].description == "Light sensor, 5V"
        assert take_back(6).slots == ("BB",)
        store = registry.runs.begin(robot)
        assert "in" not in [binding.port for binding in store.configuration("BB").bindings]
        take_back(5)
        wire = SlotBinding("in", "HelloWorldTopic_1_to_2", "HelloWorld", publishes=False)
        assert wire in store.configuration("BB").bindings
        assert store.blocked(b"", "WXYZ") == "recalled"
        take_back(4)
        assert store.blocked(b"", "WXYZ") is None
        assert store.placed_slot(b"secondUI") == "BB"
        take_back(3)
        assert store.placed_slot(b"secondUI") is None
        take_back(2)
        assert store.remembered_slot(b"secondUI") == "BB"
        take_back(1)
        assert dict(store.configuration("AA").settings)["period_s"] in ("1", "1.0")

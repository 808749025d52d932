"""The values of a recording as a Parquet file, read by pyarrow itself."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from msbot.cli.record import log
from msbot.operations.dispatch import InProcessOperations
from msbot_school.demo import DemoRobot
from tests.lab.recorded import messages, record_demo


async def a_moment(robot: DemoRobot, operations: InProcessOperations) -> None:
    import asyncio

    await asyncio.sleep(3)


def test_every_value_of_every_sample_is_a_row_with_its_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    monkeypatch.setattr("msbot.recording.recordings.conversions.BATCH", 3)  # several groups of rows
    record_demo(tmp_path, tmp_path / "a.mcap", a_moment, ("AA",))
    arguments = [str(tmp_path / name) for name in ("a.mcap", "a.parquet")]
    done = CliRunner().invoke(log.command, ["export", *arguments])
    assert done.exit_code == 0, done.output
    rows = parquet.read_table(tmp_path / "a.parquet").to_pylist()
    assert f"{len(rows)} values" in done.output
    mine = [row for row in rows if row["slot"] == "AA" and row["field"] == "index"]
    said = [one for one in messages(tmp_path / "a.mcap") if one.slot == "AA" and not one.is_repeated]
    times_us = [row["at"].timestamp() * 1e6 for row in mine]
    assert times_us == pytest.approx([one.at_ns / 1000 for one in said], abs=2)
    assert all(row["text"] is None and row["number"] is not None for row in mine)
    texts = [row for row in rows if row["slot"] == "AA" and row["field"] == "message"]
    assert texts
    assert all(row["number"] is None and isinstance(row["text"], str) for row in texts)
    again = CliRunner().invoke(log.command, ["export", *arguments])
    assert "is there already" in str(again.exception)

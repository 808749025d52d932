"""`msbot topic` in memory; in DDS and Zenoh the same is tried with the spaces' own tests."""

from __future__ import annotations

from pathlib import Path

from tests.operations.topics_in_space import tour


async def test_topics_are_listed_heard_measured_and_published(tmp_path: Path) -> None:
    await tour(tmp_path, "memory")

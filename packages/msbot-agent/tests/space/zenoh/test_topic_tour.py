"""`msbot topic` in a Zenoh space."""

from __future__ import annotations

from pathlib import Path

import pytest

from msbot_agent.space.zenoh import Router
from tests.operations.topics_in_space import tour
from tests.space.zenoh.sites import HERE


@pytest.mark.usefixtures("router")
async def test_topics_are_listed_heard_measured_and_published(tmp_path: Path, router: Router) -> None:
    await tour(tmp_path, f"zenoh:{HERE}")

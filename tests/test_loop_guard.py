"""The guard that all tests run under: it would notice a robot that waits for its database on its event loop."""

from __future__ import annotations

from pathlib import Path

import pytest

from msbot.registry import open_registry
from msbot_web.stored_data import RegistryUsers
from tests.loop_guard import LoopHeldUp


async def test_a_statement_and_a_wait_on_the_loop_are_errors_and_a_test_may_look(tmp_path: Path) -> None:
    with open_registry(tmp_path / "robot.db") as registry:
        users = RegistryUsers(registry)
        with pytest.raises(LoopHeldUp, match=r"web/stored_data.py has the event loop wait for: BEGIN"):
            users.users()
        assert registry.users.all() == []
        assert await registry.storage.in_time(users.users) == []


def test_without_an_event_loop_everybody_may_wait(tmp_path: Path) -> None:
    with open_registry(tmp_path / "robot.db") as registry:
        assert RegistryUsers(registry).users() == []

"""A demo that shares its world prints the command for the others; a password of the environment is not shown."""

from __future__ import annotations

import asyncio
import re
from types import SimpleNamespace
from typing import Any

import pytest

from msbot.cli.run.world_options import PASSWORD_VARIABLE, WorldOptions
from msbot_web.cli.demo.demo_world import DemoWorld


async def greeting(password: str | None) -> str:
    said: list[str] = []
    world = DemoWorld(WorldOptions("line", share="0", password=password), 1, said.append)
    operations: Any = SimpleNamespace(worlds=SimpleNamespace(attach=lambda living: None))
    running = [asyncio.create_task(one) for one in world.coroutines(operations)]
    async with asyncio.timeout(60):
        while not said:  # noqa: ASYNC110 - the server says it when it has its port
            await asyncio.sleep(0.01)
    for task in running:
        task.cancel()
    await asyncio.gather(*running, return_exceptions=True)
    return said[0].removeprefix("The world is shared: msbot demo --world ")


async def test_the_command_for_the_others_can_be_copied(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(PASSWORD_VARIABLE, raising=False)
    assert re.fullmatch(r"tcp:[\w-]{12}@127\.0\.0\.1:\d+", await greeting(None))
    assert re.fullmatch(r"'tcp:maze runner@127\.0\.0\.1:\d+'", await greeting("maze runner"))


async def test_a_password_of_the_environment_is_not_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PASSWORD_VARIABLE, "maze runner")
    assert re.fullmatch(r"tcp:127\.0\.0\.1:\d+ \(with the same \$MSBOT_WORLD_PASSWORD\)", await greeting(None))

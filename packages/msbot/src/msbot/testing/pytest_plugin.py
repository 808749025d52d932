"""The fixture `robot_for` of pytest: the robots that a test makes are closed when it is over."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from msbot.part import Part
    from msbot.testing.part_robot import PartRobot


@pytest.fixture
def robot_for(request: pytest.FixtureRequest) -> Iterator[Callable[..., PartRobot]]:
    """Makes a robot in virtual time for a part; the file of a program is looked for beside the test, too."""
    from msbot.testing import robot_for as make  # a run without such a test imports nothing of it

    with ExitStack() as robots:

        def made(part: Part | str | Path, **options: Any) -> PartRobot:  # noqa: ANN401 - those of `robot_for`
            beside = None if not isinstance(part, str | Path) else request.path.parent / part
            return robots.enter_context(make(beside if beside is not None and beside.exists() else part, **options))

        yield made

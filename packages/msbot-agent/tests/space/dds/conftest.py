"""Every test here has a network of its own with nothing in it but the loopback interface, and what it starts, too."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from msbot_agent.space.dds.libddsc import load
from msbot_xrce.errors import ConfigError
from tests.space.dds.foreign_programs import refuse
from tests.space.own_network import own_network


@pytest.fixture(autouse=True)
def _own_network(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)
    try:
        load()
    except ConfigError as error:
        refuse(str(error))
    with own_network():
        yield

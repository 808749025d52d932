"""Every test here has a network of its own with nothing in it but the loopback interface, and what it starts, too."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from msbot.errors import ConfigError
from msbot.space.dds.library import load
from tests.ros.genuine.environment import environment, refuse
from tests.space.own_network import own_network


@pytest.fixture(autouse=True)
def _own_network(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    for variable in ("CYCLONEDDS_URI", "ROS_DISTRO", "ROS_DOMAIN_ID", "FASTRTPS_DEFAULT_PROFILES_FILE"):
        monkeypatch.delenv(variable, raising=False)
    try:
        load()
    except ConfigError as error:
        refuse(str(error))
    environment()
    with own_network():
        yield

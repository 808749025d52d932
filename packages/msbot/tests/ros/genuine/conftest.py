"""The tests of a file share a network with nothing in it but the loopback interface, and a genuine node in it.

What another test asked of the node is taken back before each test; the robots of another test have left the network.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from msbot_agent.space.dds.libddsc import load
from msbot_xrce.errors import ConfigError
from tests.ros.genuine.environment import MIDDLEWARES, environment, refuse
from tests.ros.genuine.node import Node
from tests.space.own_network import inside, open_network


def pytest_collection_modifyitems(items: Sequence[pytest.Item]) -> None:
    """The time of a test is its own: in its fixtures the first one installs ROS 2 and builds a package."""
    for item in items:
        if item.path.is_relative_to(Path(__file__).parent) and item.get_closest_marker("timeout") is None:
            item.add_marker(pytest.mark.timeout(OWN_S, func_only=True))


OWN_S = 300


@pytest.fixture(scope="module")
def network() -> Iterator[int]:
    """The network of a file's tests."""
    try:
        load()
    except ConfigError as error:
        refuse(str(error))
    environment()
    opened = open_network()
    yield opened
    os.close(opened)


@pytest.fixture(autouse=True)
def _own_network(network: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    for variable in ("CYCLONEDDS_URI", "ROS_DISTRO", "ROS_DOMAIN_ID", "FASTRTPS_DEFAULT_PROFILES_FILE"):
        monkeypatch.delenv(variable, raising=False)
    with inside(network):
        yield


@pytest.fixture(scope="module", params=MIDDLEWARES)
def peer(request: pytest.FixtureRequest, network: int) -> Iterator[Node]:
    """A genuine node, /peer, for all tests of a file."""
    with inside(network):
        node = Node("peer", middleware=request.param)
    yield node
    node.end()


@pytest.fixture
def node(peer: Node) -> Node:
    """The same, with nothing in it from another test."""
    peer.do("forget")
    return peer

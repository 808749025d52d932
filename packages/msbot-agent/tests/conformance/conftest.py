"""Fixtures of the conformance cases."""

from collections.abc import Iterator

import pytest

from tests.conformance.agent_rig import AgentRig


@pytest.fixture
def agent() -> Iterator[AgentRig]:
    """A real agent that must still serve when the test ends."""
    rig = AgentRig()
    yield rig
    rig.close()

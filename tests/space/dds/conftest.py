"""Every test here has a network of its own with nothing in it but the loopback interface, and what it starts, too."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from msbot.errors import ConfigError
from msbot.space.dds.library import load
from tests.space.dds.foreign_programs import refuse
from tests.space.own_network import own_network


@pytest.fixture(scope="session")
def build_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where programs of others are built, once for all workers of a run."""
    run = os.environ.get("PYTEST_XDIST_TESTRUNUID")
    if run is None:
        return tmp_path_factory.mktemp("foreign")
    folder = tmp_path_factory.getbasetemp().parent / f"foreign-{run}"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(autouse=True)
def _own_network(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.delenv("CYCLONEDDS_URI", raising=False)
    try:
        load()
    except ConfigError as error:
        refuse(str(error))
    with own_network():
        yield

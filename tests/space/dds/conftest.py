"""Every test here has a network of its own with nothing in it but the loopback interface, and what it starts, too."""

from __future__ import annotations

import ctypes
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from msbot.errors import ConfigError
from msbot.space.dds.library import load
from tests.space.dds.foreign_programs import refuse

NEW_NETWORK = 0x40000000
"""CLONE_NEWNET of unshare(2)."""


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
    libc = ctypes.CDLL(None, use_errno=True)
    outside = os.open("/proc/self/ns/net", os.O_RDONLY)
    try:
        if libc.unshare(NEW_NETWORK) != 0:
            refuse(f"a network of its own needs root: {os.strerror(ctypes.get_errno())}")
        try:
            subprocess.run(["ip", "link", "set", "lo", "up"], check=True, capture_output=True)
            yield
        finally:
            assert libc.setns(outside, NEW_NETWORK) == 0
    finally:
        os.close(outside)

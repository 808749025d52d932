"""Every test here runs in one network with nothing in it but the loopback interface.

It is one for all tests of a process, because the threads of the library stay in the network in which they began.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from msbot_agent.space import TlsFiles
from msbot_agent.space.zenoh import Router
from msbot_agent.space.zenoh.zenoh_library import load
from msbot_xrce.errors import ConfigError
from tests import ROOT
from tests.space.dds.foreign_programs import refuse
from tests.space.own_network import inside, open_network
from tests.space.zenoh.sites import HERE

_network = cache(open_network)


@pytest.fixture(autouse=True)
def _own_network() -> Iterator[None]:
    try:
        load()
    except ConfigError as error:
        refuse(str(error))
    with inside(_network()):
        yield


@pytest.fixture
def router() -> Iterator[Router]:
    """A router on this computer."""
    with Router([HERE]) as made:
        yield made


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what the guide makes (`ca`, `router`, `north`), a second site, and a stranger's."""
    folder = tmp_path_factory.mktemp("certificates")
    for line in commands_of_the_guide():
        subprocess.run(line, shell=True, check=True, capture_output=True, cwd=folder)
        if "north" in line:
            other = line.replace("north", "south")
            subprocess.run(other, shell=True, check=True, capture_output=True, cwd=folder)
        if "ca.key -out ca.pem" in line:
            other = line.replace("ca.", "stranger.")
            subprocess.run(other, shell=True, check=True, capture_output=True, cwd=folder)
    return folder


def commands_of_the_guide() -> list[str]:
    """The lines with `openssl`, in their order."""
    page = ROOT / "docs/howto/zenoh.md"
    return [line for line in page.read_text().splitlines() if line.startswith("openssl ")]


def tls_of(folder: Path, name: str | None, ca: str = "ca") -> TlsFiles:
    """The files of one end."""
    own = (None, None) if name is None else (folder / f"{name}.pem", folder / f"{name}.key")
    return TlsFiles(folder / f"{ca}.pem", *own)

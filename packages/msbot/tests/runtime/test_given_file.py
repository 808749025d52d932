"""Files that a person names are read to a bound: a device has no end."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from msbot.cli.board.board_commands import _Program
from msbot_agent.idl.definitions_reader import read_definitions
from msbot_agent.idl.model import Definitions
from msbot_agent.idl.omg_reader import read_idl
from msbot_agent.space.network_options import TlsFiles
from msbot_agent.space.zenoh.router_connection import context
from msbot_agent.text.untrusted_input import read_input_file
from msbot_web.server import _tls_context
from msbot_xrce.errors import ConfigError

ZERO = Path("/dev/zero")
needs_zero = pytest.mark.skipif(not ZERO.exists(), reason="there is no /dev/zero here")


def test_a_file_is_read_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "part.py"
    path.write_bytes(b"12345")
    assert read_input_file(path, 5, "a program") == b"12345"
    with pytest.raises(ConfigError) as refused:
        read_input_file(path, 4, "a program")
    assert str(refused.value) == (f"{path} is larger than 4 bytes, or has no end: a program is not; name another file")
    with pytest.raises(FileNotFoundError):
        read_input_file(tmp_path / "nothing", 4, "a program")


@needs_zero
def test_a_program_for_a_board_has_an_end() -> None:
    with pytest.raises(ConfigError, match="/dev/zero is larger than 1,000,000 bytes, or has no end: a program is"):
        _Program(ZERO)


@needs_zero
def test_definitions_have_an_end(tmp_path: Path) -> None:
    os.symlink(ZERO, tmp_path / "a.idl")
    with pytest.raises(ConfigError, match="or has no end: a file with message definitions is not"):
        read_definitions(tmp_path / "a.idl")
    with pytest.raises(ConfigError, match="or has no end: a file with message definitions is not"):
        read_idl('#include "/dev/zero"\n', "b.idl", Definitions())


@needs_zero
def test_certificates_have_an_end() -> None:
    with pytest.raises(ConfigError, match="or has no end: a PEM file is not"):
        context(TlsFiles(ZERO, None, None))
    with pytest.raises(ConfigError, match="or has no end: a PEM file is not"):
        _tls_context(ZERO, None)

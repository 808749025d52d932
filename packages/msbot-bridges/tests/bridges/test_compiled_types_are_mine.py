"""The modules that are compiled for Cyphal are imported: no other user of the computer may change them."""

from __future__ import annotations

import logging
import os
from pathlib import Path

import pytest

from msbot_bridges.cyphal import compile_types, data_types

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows has no umask")


@pytest.mark.promise("Other users of the computer change nothing that a program of MsBOT runs")
def test_compiled_types_are_the_users_alone_whatever_the_umask_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def compile_one(folder: Path) -> None:
        folder.mkdir(parents=True)
        (folder / "reg.py").write_text("")

    monkeypatch.setattr(data_types, "compile_types", compile_one)
    monkeypatch.setenv("PYCYPHAL_NO_IMPORT_HOOK", "1")
    place = tmp_path / "cache" / "msbot" / "cyphal" / "types"
    before = os.umask(0)
    try:
        assert compile_types.main(str(place)) == 0
    finally:
        os.umask(before)
        logging.disable(logging.NOTSET)
    for path in (tmp_path / "cache", place.parent.parent, place.parent, place, place / "reg.py"):
        assert not path.stat().st_mode & 0o077, path

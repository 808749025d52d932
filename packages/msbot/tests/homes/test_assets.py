"""The files of others that the package carries are those of their publisher, to the octet (`make assets`)."""

import hashlib
import json
from pathlib import Path

import pytest

from tests import ROOT

STATIC = ROOT / "packages/msbot-web/src/msbot_web/static"


@pytest.mark.parametrize(
    ("name", "licence", "words"),
    [
        ("micropython", "MIT", "Damien P. George"),
        ("uplot", "MIT", "Leon Sorokin"),
        ("blockly", "Apache-2.0", "Apache License"),
    ],
)
def test_what_others_have_made_is_the_file_that_npm_has(name: str, licence: str, words: str) -> None:
    folder = STATIC / name
    manifest = json.loads((folder / "manifest.json").read_text())
    found = {one: hashlib.sha256((folder / Path(one).name).read_bytes()).hexdigest() for one in manifest["files"]}
    assert found == manifest["files"]
    present = {path.name for path in folder.iterdir()}
    assert present == {*(Path(one).name for one in found), "LICENSE", "manifest.json"}
    assert manifest["licence"] == licence
    assert words in (folder / "LICENSE").read_text()

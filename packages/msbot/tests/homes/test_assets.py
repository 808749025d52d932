"""The files of others that the package carries are those of their publisher, to the octet (`make assets`)."""

import hashlib
import json
from pathlib import Path

import pytest

from tests import ROOT

STATIC = ROOT / "packages/msbot-web/src/msbot_web/static"
JACDAC = ROOT / "packages/msbot-bridges/src/msbot_bridges/jacdac/static"
OURS = {"index.html", "page.css", "page.js"}
"""What stands beside them."""


@pytest.mark.parametrize(
    ("folder", "licence", "words"),
    [
        (STATIC / "micropython", "MIT", "Damien P. George"),
        (STATIC / "uplot", "MIT", "Leon Sorokin"),
        (STATIC / "blockly", "Apache-2.0", "Apache License"),
        (JACDAC, "MIT", "Microsoft"),
    ],
)
def test_what_others_have_made_is_the_file_that_npm_has(folder: Path, licence: str, words: str) -> None:
    manifest = json.loads((folder / "manifest.json").read_text())
    found = {one: hashlib.sha256((folder / Path(one).name).read_bytes()).hexdigest() for one in manifest["files"]}
    assert found == manifest["files"]
    present = {path.name for path in folder.iterdir()} - OURS
    assert present == {*(Path(one).name for one in found), "LICENSE", "manifest.json"}
    assert manifest["licence"] == licence
    assert words in (folder / "LICENSE").read_text()


def test_the_lists_for_mip_name_every_module_of_the_package_for_boards_once() -> None:
    folder = ROOT / "micropython"
    lists = [json.loads((folder / f"{name}.json").read_text())["urls"] for name in ("package", "generic")]
    named = [target for urls in lists for target, source in urls if target == source]
    assert sorted(named) == sorted(f"msbot/{path.name}" for path in (folder / "msbot").glob("*.py"))

"""The files of others that the package carries are those of their publisher, to the octet (`make assets`)."""

import hashlib
import json
from pathlib import Path

FOLDER = Path(__file__).parents[2] / "src/msbot/web/static/micropython"


def test_micropythons_vm_is_the_file_that_npm_has() -> None:
    manifest = json.loads((FOLDER / "manifest.json").read_text())
    found = {name: hashlib.sha256((FOLDER / name).read_bytes()).hexdigest() for name in manifest["files"]}
    assert found == manifest["files"]
    assert sorted(path.name for path in FOLDER.iterdir()) == sorted([*found, "LICENSE", "manifest.json"])
    assert "Damien P. George" in (FOLDER / "LICENSE").read_text()

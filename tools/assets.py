"""Fetches the files of others that the project carries unmodified, from npm: MicroPython's VM for the browser, uPlot,
which draws curves, Blockly, whose blocks become programs, jacdac-ts, which speaks with Jacdac modules by USB, and
axe-core, which looks in tests whether everybody can use the pages.

    python tools/assets.py                      the versions of the manifests; says so when a file is another one
    python tools/assets.py micropython 1.28.0   another version, with a new manifest

Needs npm. Users do not: the files are part of the package.
"""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = {
    "micropython": ROOT / "packages/msbot-web/src/msbot_web/static/micropython",
    "uplot": ROOT / "packages/msbot-web/src/msbot_web/static/uplot",
    "blockly": ROOT / "packages/msbot-web/src/msbot_web/static/blockly",
    "jacdac": ROOT / "packages/msbot-bridges/src/msbot_bridges/jacdac/static",
    "axe-core": ROOT / "packages/msbot-web/tests/web/browser/axe-core",
}
"""Each with a manifest: package, version, and the SHA-256 of every file by its path in the package."""


def fetch(target: Path, version: str | None) -> int:
    """Fetch, compare, write; returns the exit status."""
    manifest = json.loads((target / "manifest.json").read_text())
    wanted = version or manifest["version"]
    with tempfile.TemporaryDirectory() as folder:
        command = ["npm", "pack", "--silent", f"{manifest['package']}@{wanted}"]
        name = subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True).stdout.split()[-1]
        with tarfile.open(Path(folder) / name) as archive:
            fetched = {file: _read(archive, f"package/{file}") for file in manifest["files"]}
    hashes = {file: hashlib.sha256(octets).hexdigest() for file, octets in fetched.items()}
    different = [file for file in hashes if hashes[file] != manifest["files"][file]]
    if different and version is None:
        sys.stderr.write(f"{', '.join(different)}: npm has another file for version {wanted} than the manifest\n")
        return 1
    for file, octets in fetched.items():
        (target / Path(file).name).write_bytes(octets)
    (target / "manifest.json").write_text(json.dumps({**manifest, "version": wanted, "files": hashes}, indent=2) + "\n")
    return 0


def _read(archive: tarfile.TarFile, name: str) -> bytes:
    file = archive.extractfile(name)
    assert file is not None
    return file.read()


def main(arguments: list[str]) -> int:
    """What is asked for on the command line."""
    if arguments:
        return fetch(FOLDERS[arguments[0]], arguments[1])
    return max(fetch(target, None) for target in FOLDERS.values())


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))

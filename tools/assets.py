"""Fetches the files of others that the project carries unmodified, from npm: MicroPython's VM for the browser, uPlot,
which draws curves, Blockly, whose blocks become programs, jacdac-ts, which speaks with Jacdac modules by USB, and
axe-core, which looks in tests whether everybody can use the pages. The site of the docs also has Pyodide, Python for
the browser, which is too large to be carried along: `make docs` fetches it.

    python tools/assets.py                      the versions of the manifests; says so when a file is another one
    python tools/assets.py pyodide              only these
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
    "pyodide": ROOT / "tools/tab_page",
}
"""Each with a manifest: package, version, and the SHA-256 of every file by its path in the package."""
NOT_CARRIED = {"pyodide": ROOT / "build/pyodide"}
"""Where files go that are in no commit."""


def fetch(name: str, version: str | None) -> int:
    """Fetch, compare, write; returns the exit status."""
    folder = FOLDERS[name]
    target = NOT_CARRIED.get(name, folder)
    manifest = json.loads((folder / "manifest.json").read_text())
    wanted = version or manifest["version"]
    with tempfile.TemporaryDirectory() as scratch:
        command = ["npm", "pack", "--silent", f"{manifest['package']}@{wanted}"]
        packed = subprocess.run(command, cwd=scratch, check=True, capture_output=True, text=True).stdout.split()[-1]
        with tarfile.open(Path(scratch) / packed) as archive:
            fetched = {file: _read(archive, f"package/{file}") for file in manifest["files"]}
    hashes = {file: hashlib.sha256(octets).hexdigest() for file, octets in fetched.items()}
    different = [file for file in hashes if hashes[file] != manifest["files"][file]]
    if different and version is None:
        sys.stderr.write(f"{', '.join(different)}: npm has another file for version {wanted} than the manifest\n")
        return 1
    target.mkdir(parents=True, exist_ok=True)
    for file, octets in fetched.items():
        (target / Path(file).name).write_bytes(octets)
    (folder / "manifest.json").write_text(json.dumps({**manifest, "version": wanted, "files": hashes}, indent=2) + "\n")
    return 0


def stored(name: str) -> dict[str, bytes]:
    """The files that are in no commit, by name: from the folder where they are kept, or fetched.

    Raises:
        FetchError: npm is missing, cannot be reached, or has other files than the manifest says.
    """
    try:
        if not is_stored(name) and fetch(name, None):
            raise FetchError(f"the files of {name} are not those of its manifest; see above")
    except FileNotFoundError:
        raise FetchError(f"{name} comes from npm, and there is none here: apt install npm") from None
    except subprocess.CalledProcessError as error:
        raise FetchError(f"npm cannot fetch {name}: {error.stderr.strip() or error}") from None
    return {file: (NOT_CARRIED[name] / file).read_bytes() for file in _hashes(name)}


def is_stored(name: str) -> bool:
    """Whether these files were fetched before, and are those of the manifest."""
    paths = {NOT_CARRIED[name] / file: wanted for file, wanted in _hashes(name).items()}
    return all(
        path.is_file() and hashlib.sha256(path.read_bytes()).hexdigest() == wanted for path, wanted in paths.items()
    )


class FetchError(Exception):
    """Files of others are not to be had; the text says why."""


def _hashes(name: str) -> dict[str, str]:
    files: dict[str, str] = json.loads((FOLDERS[name] / "manifest.json").read_text())["files"]
    return files


def _read(archive: tarfile.TarFile, name: str) -> bytes:
    file = archive.extractfile(name)
    assert file is not None
    return file.read()


def main(arguments: list[str]) -> int:
    """What is asked for on the command line."""
    if arguments:
        return fetch(arguments[0], arguments[1] if len(arguments) > 1 else None)
    return max(fetch(name, None) for name in FOLDERS)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))

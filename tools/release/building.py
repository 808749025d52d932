"""Builds sdists and wheels of a commit, twice in two folders, and compares them octet by octet."""

from __future__ import annotations

import filecmp
import gzip
import hashlib
import io
import os
import subprocess
import sys
import tarfile
from collections.abc import Iterable
from pathlib import Path

from tools.sources import PACKAGES, ROOT

DISTRIBUTIONS = tuple(package.parents[1].name for package in PACKAGES)


class ReleaseError(Exception):
    """There is no release; the text says why, and what would be right."""


def git(*arguments: str, root: Path = ROOT) -> str:
    """What git answers."""
    return subprocess.run(["git", *arguments], cwd=root, check=True, capture_output=True, text=True).stdout.strip()


def export(commit: str, folder: Path) -> None:
    """Write the files of a commit into a new folder; git writes the commit's name into `build.txt` (`export-subst`)."""
    packed = subprocess.run(["git", "archive", commit], cwd=ROOT, check=True, capture_output=True).stdout
    folder.mkdir(parents=True)
    with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
        archive.extractall(folder, filter="data")


def build(tree: Path, into: Path, epoch: int) -> list[Path]:
    """Build an sdist and a wheel of each distribution of an exported tree; returns the files."""
    into = into.absolute()
    environment = {**os.environ, "SOURCE_DATE_EPOCH": str(epoch), "PYTHONDONTWRITEBYTECODE": "1"}
    pages = [sys.executable, "tools/man_pages.py"]
    subprocess.run(pages, cwd=tree, env=environment, check=True)
    # What the commands say of themselves comes from the commands installed here: the same commit, as the tree is clean.
    subprocess.run([sys.executable, tree / "tools/man_pages.py"], env=environment, check=True)
    for name in DISTRIBUTIONS:
        _hatchling(tree / "packages" / name, into, environment, "--target", "sdist", "--target", "wheel")
    return sorted(into.iterdir())


def build_from_sdist(sdist: Path, scratch: Path, epoch: int) -> Path:
    """Build the wheel again from an sdist alone; returns it."""
    with tarfile.open(sdist) as archive:
        archive.extractall(scratch / "tree", filter="data")
    (tree,) = (scratch / "tree").iterdir()
    into = (scratch / "wheel").absolute()
    environment = {**os.environ, "SOURCE_DATE_EPOCH": str(epoch), "PYTHONDONTWRITEBYTECODE": "1"}
    _hatchling(tree, into, environment, "--target", "wheel")
    (wheel,) = into.iterdir()
    return wheel


def _hatchling(project: Path, into: Path, environment: dict[str, str], *what: str) -> None:
    command = [sys.executable, "-m", "hatchling", "build", *what, "--directory", str(into)]
    done = subprocess.run(command, cwd=project, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise ReleaseError(f"{project.name} cannot be built:\n{done.stdout}{done.stderr}")


def check_same(first: Iterable[Path], second: Iterable[Path]) -> None:
    """Compare the files of two builds.

    Raises:
        ReleaseError: they differ.
    """
    one, other = ({path.name: path for path in paths} for paths in (first, second))
    if alone := sorted(one.keys() ^ other.keys()):
        raise ReleaseError(f"only one of two builds made {', '.join(alone)}")
    if different := [name for name in sorted(one) if not filecmp.cmp(one[name], other[name], shallow=False)]:
        raise ReleaseError(f"two builds of one commit differ in {', '.join(different)}")


def pack(folder: Path, name: str, into: Path, epoch: int) -> Path:
    """Pack a folder into `NAME.tar.gz`: in order, with one time, without owners."""
    path = into / f"{name}.tar.gz"
    with (
        path.open("wb") as file,
        gzip.GzipFile("", "wb", mtime=epoch, fileobj=file) as packed,
        tarfile.open(fileobj=packed, mode="w|") as archive,
    ):
        for each in sorted(folder.rglob("*")):
            entry = archive.gettarinfo(each, f"{name}/{each.relative_to(folder).as_posix()}")
            entry.mtime, entry.uid, entry.gid, entry.uname, entry.gname = epoch, 0, 0, "", ""
            entry.mode = 0o755 if each.is_dir() else 0o644
            with each.open("rb") if each.is_file() else io.BytesIO() as content:
                archive.addfile(entry, content if each.is_file() else None)
    return path


def write_sums(folder: Path) -> Path:
    """Write SHA256SUMS of all files of the folder, in the form of sha256sum(1)."""
    sums = folder / "SHA256SUMS"
    files = sorted(path for path in folder.iterdir() if path.is_file() and path != sums)
    sums.write_text("".join(f"{sha256(path)}  {path.name}\n" for path in files), "ascii")
    return sums


def sha256(path: Path) -> str:
    """The hash of a file, in hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

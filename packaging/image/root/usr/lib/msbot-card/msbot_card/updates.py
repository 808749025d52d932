"""Versions of MsBOT on the card: that of the image, which stays, and those that came by the page.

An update replaces the programs of MsBOT, not those of Debian. Of the package only what lies under `usr/lib/msbot` is
used; its scripts are not run, so it has the rights of the robot's service and no others. The first start with an update
is a trial: before it, the database is copied; if the page is not healthy then, the former version and the copy are put
back.

The power may go at any step. What the next start does is in one small file, which is replaced as a whole; each step
that it asks for can be repeated, and is done before the file says so.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import tarfile
from dataclasses import asdict, dataclass, replace
from pathlib import Path, PurePosixPath
from typing import IO

from msbot_card.files import alone_in, keep, read, sync_folder

LARGEST = 300 << 20
"""Octets of a package."""
LARGEST_UNPACKED = 1200 << 20
MOST_FILES = 60_000
VERSION = re.compile(r"[0-9][0-9A-Za-z.+~-]{0,63}")
PREFIX = PurePosixPath("usr/lib/msbot")
LINKS = {"/usr/bin/python3", "python3", "lib"}
"""Where links of an environment lead."""
TRIES = 2
"""Starts that a trial has."""
UNFINISHED = "unfinished-"
"""Before the name of a folder that is being made or removed."""
PACKAGE = "update.deb"
"""The package that is being taken in."""
COPY = "database-of-"
"""Before the version, or `image`: the folder of its database."""


class UpdateError(Exception):
    """There is no update; the text says why.

    Args:
        words: the text.
        reason: a word for it, by which the page finds a translation.
    """

    def __init__(self, words: str, reason: str = "package") -> None:
        super().__init__(words)
        self.reason = reason


@dataclass(frozen=True, slots=True)
class Versions:
    """Which version runs. Empty: that of the image."""

    current: str = ""
    former: str = ""
    trial: bool = False
    """The current one has not been healthy yet."""
    starts: int = 0
    """Of the trial."""
    back: bool = False
    """The next start goes back to the former one."""
    aside: bool = False
    """It has begun to: the newer database is out of the way, and what is in its place is the former one's."""
    told: str = ""
    """What happened last, for the page: `updated`, `fell back`, `went back`."""


def check_head(fields: str) -> str:
    """The version of a package, from what `dpkg-deb --field` says.

    Raises:
        UpdateError: it is not MsBOT for this card.
    """
    found = dict(line.split(": ", 1) for line in fields.splitlines() if ": " in line and not line.startswith(" "))
    if found.get("Package") != "msbot" or found.get("Architecture") != "arm64":
        raise UpdateError("an update is the package msbot for arm64, msbot_VERSION_arm64.deb")
    version = found.get("Version", "")
    if not VERSION.fullmatch(version):
        raise UpdateError("the package has no version that makes sense")
    return version


def unpack(archive: IO[bytes], into: Path) -> None:
    """Unpack the environment of MsBOT from a package's tar; nothing else of it, and nothing outside the folder.

    Raises:
        UpdateError: it is damaged, too large, or has what an environment has not.
    """
    size = count = 0
    links: list[tuple[Path, str]] = []
    try:
        with tarfile.open(fileobj=archive, mode="r|") as tar:
            for member in tar:
                name = PurePosixPath(member.name)
                if ".." in name.parts or name.is_absolute():
                    raise UpdateError(f"the package has a file outside of itself: {member.name!r}")
                if not name.is_relative_to(PREFIX):
                    continue
                target = into / name.relative_to(PREFIX)
                size, count = size + member.size, count + 1
                if size > LARGEST_UNPACKED or count > MOST_FILES:
                    raise UpdateError("the package is too large for an update")
                if member.isdir():
                    target.mkdir(mode=0o755, exist_ok=True)
                elif member.isreg():
                    content = tar.extractfile(member)
                    assert content is not None
                    mode = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
                    with os.fdopen(os.open(target, mode, 0o755 if member.mode & 0o100 else 0o644), "wb") as file:
                        shutil.copyfileobj(content, file)
                elif member.issym() and member.linkname in LINKS:
                    links.append((target, member.linkname))
                else:
                    raise UpdateError(f"the package has something strange: {member.name!r}")
    except (tarfile.TarError, OSError) as error:
        raise UpdateError(f"the package cannot be unpacked: {error}") from None
    for target, link in links:  # at the end, so that nothing is written through one
        target.symlink_to(link)


@dataclass(frozen=True, slots=True)
class Store:
    """The versions on the data partition.

    Args:
        folder: where they are.
        database: the robot's, on the same file system and by the same mount: files are moved between the two.
        python: the folder that an environment has for the card's Python, e.g. `python3.11`.
    """

    folder: Path
    database: Path
    python: str

    @property
    def _file(self) -> Path:
        return self.folder / "versions.json"

    def _copy(self, version: str) -> Path:
        """The database as a version had it last, which it can open again; empty: that of the image."""
        return self.folder / f"{COPY}{version or 'image'}"

    def place(self, version: str) -> Path:
        """Where a version's environment is."""
        return self.folder / "versions" / version

    def versions(self) -> Versions:
        """Which version runs; a file that cannot be read means that of the image."""
        text = read(self._file, 4096)
        if text is None:
            return Versions()
        try:
            found = Versions(**json.loads(text))
        except (ValueError, TypeError):
            return Versions(told="fell back")
        for version in (found.current, found.former):
            if version and not (VERSION.fullmatch(version) and self.place(version).is_dir()):
                return Versions(told="fell back")
        return found

    def _keep(self, versions: Versions) -> Versions:
        keep(self._file, json.dumps(asdict(versions)).encode())
        return versions

    def take_in(self, package: Path, image: str) -> Versions:
        """Unpack a package and have it run from the next start on.

        Args:
            package: its file, which is root's: nobody changes it meanwhile.
            image: the version of the image.

        Raises:
            UpdateError: it is no update.
        """
        told = subprocess.run(
            ["/usr/bin/dpkg-deb", "--field", str(package)], capture_output=True, text=True, check=False
        )
        if told.returncode:
            raise UpdateError("the file is no Debian package")
        version, now = check_head(told.stdout), self.versions()
        if version == (now.current or image):
            raise UpdateError(f"MsBOT {version} is what runs", "running")
        if version == now.former:
            raise UpdateError(f"MsBOT {version} is the former version: go back to it", "running")
        if now.trial:
            raise UpdateError("an update is on trial: wait until the page says that it is well", "trial")
        growing, place = self.folder / f"{UNFINISHED}version", self.place(version)
        shutil.rmtree(growing, ignore_errors=True)
        growing.mkdir(mode=0o755, parents=True)
        with subprocess.Popen(["/usr/bin/dpkg-deb", "--fsys-tarfile", str(package)], stdout=subprocess.PIPE) as tar:
            assert tar.stdout is not None
            try:
                unpack(tar.stdout, growing)
            except UpdateError:
                tar.kill()
                raise
        if tar.returncode:
            raise UpdateError("the package is damaged")
        if not (growing / "lib" / self.python / "site-packages").is_dir() or not (growing / "bin/msbot").is_file():
            raise UpdateError(f"the package is for another Debian: this card has {self.python}")
        os.sync()
        self._discard(place)
        place.parent.mkdir(mode=0o755, exist_ok=True)
        growing.rename(place)
        sync_folder(place.parent)
        with alone_in(self.folder):
            made = self._keep(Versions(current=version, former=now.current, trial=True, told=""))
        self._forget_others(made)
        return made

    def ask_back(self) -> Versions:
        """Have the next start go back.

        Raises:
            UpdateError: there is no former version.
        """
        with alone_in(self.folder):  # the trial may end in this moment
            now = self.versions()
            if not now.current:
                raise UpdateError("there is no former version", "former")
            return self._keep(replace(now, back=True))

    def _go_back(self, now: Versions) -> Versions:
        """Have the former version run from now on, with its own database; the newer one is kept beside it.

        A trial that was never started has changed no database, and has no copy of its own.
        """
        copy = self._copy(now.former)
        if copy.is_dir() and not (now.trial and now.starts == 0):
            if not now.aside:
                self._set_aside(now.current)
                now = self._keep(replace(now, back=True, aside=True))
            for path in sorted(copy.iterdir()):  # moved: a full card has no room for another copy
                _same_owner(self.database.parent, path)
                path.replace(self.database.with_name(path.name))
            sync_folder(self.database.parent)
        made = self._keep(Versions(current=now.former, told="fell back" if now.trial else "went back"))
        self._discard(copy)
        self._forget_others(made)
        return made

    def _set_aside(self, version: str) -> None:
        """Give the database another name. It comes first and its journals follow: where it is gone, they may go."""
        later = self.database.with_name(f"{self.database.name}.of-{version}")
        if self.database.is_file():
            for path in reversed(self._files(later)):  # of an earlier way back from the same version
                path.unlink()
        for path in self._files(self.database):
            path.replace(later.with_name(later.name + path.name[len(self.database.name) :]))
        sync_folder(self.database.parent)

    def begin(self) -> Versions:
        """What runs in this start: called before the master."""
        self._forget_unfinished()
        now = self.versions()
        if now.back or (now.trial and now.starts >= TRIES):
            return self._go_back(now)
        if not now.trial:
            return now
        if now.starts == 0:
            try:
                self._copy_database(self._copy(now.former))
            except OSError:  # a full card: without a way back there is no trial
                made = self._keep(Versions(current=now.former, told="fell back"))
                self._forget_unfinished()
                self._forget_others(made)
                return made
        return self._keep(replace(now, starts=now.starts + 1))

    def end_trial(self, healthy: bool) -> Versions:
        """Note what came of the trial; the next start goes back if the page was not well."""
        with alone_in(self.folder):  # somebody may ask for the way back in this moment
            now = self.versions()
            if not now.trial:
                return now
            after = replace(now, trial=False, starts=0, told="updated") if healthy else replace(now, back=True)
            return self._keep(after)

    def _copy_database(self, copy: Path) -> None:
        growing = self.folder / f"{UNFINISHED}database"
        shutil.rmtree(growing, ignore_errors=True)
        growing.mkdir(mode=0o700)
        for path in self._files(self.database):
            shutil.copy2(path, growing)
        os.sync()
        self._discard(copy)
        growing.rename(copy)
        sync_folder(self.folder)

    def _discard(self, folder: Path) -> None:
        """Remove a folder at once as a whole: a part of it must never be taken for all of it."""
        if folder.is_dir():
            place = self.folder / f"{UNFINISHED}{folder.name}"
            shutil.rmtree(place, ignore_errors=True)
            folder.rename(place)
            sync_folder(folder.parent)
            shutil.rmtree(place, ignore_errors=True)

    def _forget_unfinished(self) -> None:
        """What was being made, or removed, when the power went."""
        for path in self.folder.glob(f"{UNFINISHED}*"):
            shutil.rmtree(path, ignore_errors=True)
        (self.folder / PACKAGE).unlink(missing_ok=True)

    @staticmethod
    def _files(database: Path) -> list[Path]:
        """The database with its journals; nobody has it open."""
        return [path for end in ("", "-wal", "-shm") if (path := Path(f"{database}{end}")).is_file()]

    def _forget_others(self, used: Versions) -> None:
        for place in (self.folder / "versions").iterdir():
            if place.name not in (used.current, used.former):
                self._discard(place)
        # One can always go back to the image, so its database stays as long as another version runs.
        kept = {self._copy(used.former).name, self._copy("").name} if used.current else set()
        for copy in self.folder.glob(f"{COPY}*"):
            if copy.name not in kept:
                self._discard(copy)


def _same_owner(folder: Path, path: Path) -> None:
    owner = folder.stat()
    os.chown(path, owner.st_uid, owner.st_gid)

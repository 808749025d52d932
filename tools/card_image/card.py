"""Puts the card together: root folder, boot folder, file systems, partition table. Nothing is mounted for it."""

from __future__ import annotations

import gzip
import hashlib
import shutil
from pathlib import Path

from tools.card_image import base, drivers, partitions
from tools.card_image.base import FILES, ImageError, inside, run

SIGNATURE = 0x4D53424F
DISK = f"{SIGNATURE:08x}"
"""Of the card: Linux finds its partitions by it."""
MIB = 1 << 20
BOOT_SIZE = 256 * MIB
DATA_SIZE = 64 * MIB
"""As flashed; the first start gives it the rest of the card."""
SPARE = 1.15
"""How much larger than its files a file system is."""
ENABLED = (
    "msbot-master.service",
    "msbot-backup.timer",
    "systemd-networkd.service",
    "systemd-resolved.service",
    "systemd-timesyncd.service",
    "avahi-daemon.service",
)
DISABLED = (
    "apt-daily.timer",
    "apt-daily-upgrade.timer",
    "dpkg-db-backup.timer",
    "e2scrub_all.timer",
    "e2scrub_reap.service",
    "wpa_supplicant.service",
)
"""What makes no sense where the root is read only, or is started otherwise."""
MASKED = (
    "systemd-networkd-wait-online.service",
    "systemd-binfmt.service",
    "proc-sys-fs-binfmt_misc.automount",
)
"""A robot starts without a network, too, and runs no programs of other kinds of computers."""
EMPTIED = ("boot", "var/lib/apt/lists", "var/cache/apt", "var/cache/debconf", "var/log", "tmp", "run")
DATA = {"msbot": "var/lib/msbot", "agent": "var/lib/msbot-agent", "clock": "var/lib/systemd/timesync", "card": ""}
"""Folders of the data partition, and where they are seen (`etc/fstab`)."""
FIRMWARE = ("bootcode.bin", "start*.elf", "fixup*.dat", "LICENCE.broadcom")
BOARDS = ("bcm2710-*.dtb", "bcm2711-*.dtb", "bcm2712*.dtb", "bcm2837-*.dtb")
"""Descriptions of the Raspberry Pi 3, 4 and 5."""


def make(into: Path, kept: Path, package: Path) -> Path:
    """Make the image; returns its file.

    Args:
        into: the folder.
        kept: what the next build can use again.
        package: the Debian package of MsBOT, for 64-bit Arm.

    Raises:
        ImageError: a program is missing, or fails.
    """
    archive = base.make(kept)
    base.run_arm_programs()
    root, boot, data = (kept / name for name in ("root", "boot", "data"))
    base.unpack(archive, root)
    run("dpkg", f"--root={root}", "--force-architecture", "--install", package)
    _install_files(root)
    _start_at_boot(root)
    initrd = _initramfs(root, kept)
    _boot_folder(root, boot, initrd)
    _empty(root)
    _data_folder(root, data)
    return _image(into, kept, root, boot, data)


def _install_files(root: Path) -> None:
    """The card's own files over Debian's."""
    for path in sorted((FILES / "root").rglob("*")):
        target = root / path.relative_to(FILES / "root")
        if path.is_dir():
            target.mkdir(mode=0o755, exist_ok=True)
        elif path.suffix != ".pyc":
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(path.read_text("utf-8").replace("@DISK@", DISK), "utf-8")
            target.chmod(0o755 if path.stat().st_mode & 0o100 else 0o644)
    for name in ("data", "boot/firmware"):
        (root / name).mkdir(mode=0o755, parents=True, exist_ok=True)
    resolver = root / "etc/resolv.conf"
    resolver.unlink(missing_ok=True)
    resolver.symlink_to("../run/systemd/resolve/stub-resolv.conf")
    (root / "etc/hostname").write_text("msbot\n", "utf-8")
    (root / "etc/hosts").write_text("127.0.0.1 localhost\n127.0.1.1 msbot\n::1 localhost\n", "utf-8")


def _start_at_boot(root: Path) -> None:
    own = [path.name for path in (FILES / "root/usr/lib/systemd/system").glob("*.*") if "[Install]" in path.read_text()]
    inside(root, "systemctl", "--quiet", "enable", *ENABLED, *sorted(own))
    inside(root, "systemctl", "--quiet", "disable", *DISABLED)
    inside(root, "systemctl", "--quiet", "mask", *MASKED)


def _initramfs(root: Path, kept: Path) -> Path:
    """The initramfs with the card's scripts: made anew when they or the Debian have changed."""
    said = hashlib.sha256(base.key().encode())
    for path in sorted((FILES / "root/etc/initramfs-tools").rglob("*")):
        if path.is_file():
            said.update(path.read_bytes())
    made = kept / f"initrd-{said.hexdigest()[:16]}.img"
    if not made.exists():
        # What raspi-firmware does after each initramfs would look for a mounted boot partition.
        shutil.rmtree(root / "etc/initramfs/post-update.d", ignore_errors=True)
        (modules,) = (root / "usr/lib/modules").iterdir()
        with (root / "etc/initramfs-tools/modules").open("a", encoding="utf-8") as listed:
            listed.writelines(f"{name}\n" for name in drivers.of_boards(_trees(root), modules))
        shutil.copyfile(modules / "config", root / "boot" / f"config-{modules.name}")  # says how it may be packed
        inside(root, "update-initramfs", "-c", "-k", modules.name)
        found = root / "boot" / f"initrd.img-{modules.name}"
        for older in kept.glob("initrd-*.img"):
            older.unlink()
        shutil.copyfile(found, made)
    return made


def _boot_folder(root: Path, boot: Path, initrd: Path) -> None:
    """What the firmware reads: itself, kernel, initramfs, descriptions of boards, config.txt."""
    base.remove_folder(boot)
    (boot / "overlays").mkdir(parents=True)
    (kernel,) = (root / "usr/lib/modules").glob("*/vmlinuz")
    (boot / "vmlinuz").write_bytes(plain_kernel(kernel.read_bytes()))
    shutil.copyfile(initrd, boot / "initrd.img")
    folder = root / "usr/lib/raspi-firmware"
    for path in [*(path for name in FIRMWARE for path in folder.glob(name)), *_trees(root)]:
        shutil.copyfile(path, boot / path.name)
    for path in (FILES / "boot").iterdir():
        (boot / path.name).write_text(path.read_text("utf-8").replace("@DISK@", DISK), "utf-8")
    for path in (FILES / "overlays").glob("*.dts"):
        run("dtc", "-@", "-q", "-I", "dts", "-O", "dtb", "-o", boot / "overlays" / f"{path.stem}.dtbo", path)


def _trees(root: Path) -> list[Path]:
    """The device trees of the boards."""
    (folder,) = (root / "usr/lib").glob("linux-image-*/broadcom")
    return sorted(path for name in BOARDS for path in folder.glob(name))


def plain_kernel(image: bytes) -> bytes:
    """A kernel as the firmware and qemu start it: not wrapped for EFI ("zboot"), as Debian's can be.

    Raises:
        ImageError: it is wrapped in a way that is not known here.
    """
    if image[4:8] != b"zimg":
        return image
    start, size = int.from_bytes(image[8:12], "little"), int.from_bytes(image[12:16], "little")
    kind, packed = image[24:56].split(b"\0")[0].decode("ascii", "replace"), image[start : start + size]
    if kind == "gzip":
        return gzip.decompress(packed)
    raise ImageError(f"the kernel is packed with {kind!r}; gzip is known here")


def _empty(root: Path) -> None:
    """Take out what the card does not need; the kernel is on the boot partition."""
    for name in EMPTIED:
        for path in (root / name).iterdir():
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()
    (root / "boot/firmware").mkdir(mode=0o755)
    (root / "etc/machine-id").write_bytes(b"")  # each start makes one up


def _data_folder(root: Path, data: Path) -> None:
    base.remove_folder(data)
    data.mkdir(mode=0o755)
    owners = {}
    for line in (root / "etc/passwd").read_text("utf-8").splitlines():
        name, _, user, group, *_ = line.split(":")
        owners[name] = (int(user), int(group))
    for name, seen in DATA.items():
        (data / name).mkdir(mode=0o755 if name == "clock" else 0o700)
        owner = {"msbot": "msbot", "agent": "msbot", "clock": "systemd-timesync"}.get(name, "root")
        shutil.chown(data / name, *owners[owner])
        if seen:
            (root / seen).mkdir(mode=0o700, parents=True, exist_ok=True)


def _image(into: Path, kept: Path, root: Path, boot: Path, data: Path) -> Path:
    """File systems made of folders, and one behind the other."""
    used = int(run("du", "--summarize", "--block-size=1", root).split()[0])
    table = partitions.lay_out(
        [
            (partitions.FAT32_LBA, BOOT_SIZE),
            (partitions.LINUX, int(used * SPARE) + 64 * MIB),
            (partitions.LINUX, DATA_SIZE),
        ]
    )
    systems = [kept / name for name in ("boot.fat", "root.ext4", "data.ext4")]
    for system, partition in zip(systems, table, strict=True):
        system.unlink(missing_ok=True)
        with system.open("wb") as file:
            file.truncate(partition.size)
    run("mkfs.vfat", "-F", "32", "-n", "MSBOT", systems[0])
    run("mcopy", "-s", "-i", systems[0], *sorted(boot.iterdir()), "::")
    # The root is never written to, so it needs no journal.
    run("mkfs.ext4", "-q", "-F", "-L", "msbot-root", "-O", "^has_journal", "-m", "0", "-d", root, systems[1])
    run("mkfs.ext4", "-q", "-F", "-L", "msbot-data", "-b", "4096", "-i", "16384", "-m", "1", "-d", data, systems[2])
    into.mkdir(parents=True, exist_ok=True)
    growing, image = into / "msbot-pi.img.growing", into / "msbot-pi.img"
    with growing.open("wb") as file:
        file.write(partitions.table(table, SIGNATURE))
        file.truncate(table[-1].start + table[-1].size)
    for system, partition in zip(systems, table, strict=True):
        words = ("if=" + str(system), "of=" + str(growing), "bs=4M", f"seek={partition.start // (4 * MIB)}")
        run("dd", *words, "conv=notrunc,sparse", "status=none")
    return growing.replace(image)

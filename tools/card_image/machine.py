"""A virtual 64-bit Arm computer that runs from the card's image: qemu-system-aarch64, all in software.

Its board is qemu's `virt`, no Raspberry Pi: kernel and initramfs come out of the image's boot partition by qemu, not by
the firmware. Network: only this computer, at 127.0.0.1.
"""

from __future__ import annotations

import re
import socket
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

from tools.card_image.base import ImageError, run
from tools.card_image.forgetful_disk import ForgetfulDisk
from tools.card_image.partitions import read

PAGE, PARTS = 80, 8888
"""Ports of the robot on the card."""
MEMORY_MB = 1024
CUT_S = 60.0
"""How long a killed machine may take to let its disk go."""
_COLOURS = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


def out_of(image: Path, name: str, into: Path) -> Path:
    """A file of the boot partition."""
    with image.open("rb") as file:
        _, (boot, *_) = read(file.read(512))
    target = into / name
    target.unlink(missing_ok=True)
    run("mcopy", "-i", f"{image}@@{boot.start}", f"::{name}", target)
    return target


def free_port(kind: socket.SocketKind) -> int:
    """A port of this computer that nobody uses."""
    with socket.socket(socket.AF_INET, kind) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


class Machine:
    """The computer, off.

    Args:
        card: the image that it runs from, and writes to.
        folder: for what it needs besides.
        seed: of the chance by which a cut of the power loses writes.
        hardware: what it has besides, in the words of qemu.
        asked: what the kernel's command line has besides.
    """

    def __init__(self, card: Path, folder: Path, seed: int, hardware: Sequence[str] = (), asked: str = "") -> None:
        self._folder, self._hardware = folder, hardware
        self._kernel, self._initrd, line = (
            out_of(card, name, folder) for name in ("vmlinuz", "initrd.img", "cmdline.txt")
        )
        self._line = (
            line.read_text("utf-8").replace("quiet", "").strip() + f" console=ttyAMA0 systemd.show_status=1 {asked}"
        )
        self.disk = ForgetfulDisk(card, folder / "disk.socket", seed)
        self._process: subprocess.Popen[bytes] | None = None
        self._log = folder / "console.log"
        self.page_port, self.parts_port = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_DGRAM)
        self.started_at = 0.0
        self._for_good = False

    @property
    def console(self) -> str:
        """What it has said since it was switched on."""
        return _COLOURS.sub("", self._log.read_text("utf-8", "replace")) if self._log.exists() else ""

    def switch_on(self) -> None:
        """Start it.

        Raises:
            ImageError: the trial has ended meanwhile.
        """
        if self._for_good:
            raise ImageError("the trial has ended")
        self._log.unlink(missing_ok=True)
        words = ["qemu-system-aarch64", "-machine", "virt", "-cpu", "cortex-a72", "-smp", "2", "-m", str(MEMORY_MB)]
        words += ["-nodefaults", "-display", "none", "-monitor", "none", "-serial", f"file:{self._log}"]
        words += ["-kernel", str(self._kernel), "-initrd", str(self._initrd), "-append", self._line]
        words += ["-drive", f"if=none,id=card,format=raw,cache=writeback,file=nbd:unix:{self._folder / 'disk.socket'}"]
        words += ["-device", "virtio-blk-pci,drive=card", "-device", "virtio-rng-pci"]
        ways = f"hostfwd=tcp:127.0.0.1:{self.page_port}-:{PAGE},hostfwd=udp:127.0.0.1:{self.parts_port}-:{PARTS}"
        words += ["-netdev", f"user,id=net,{ways}", "-device", "virtio-net-pci,netdev=net,romfile=", *self._hardware]
        self.started_at = time.monotonic()
        # A session of its own: Ctrl-C is for the trial, and the scheduler shares the processor out by sessions.
        self._process = subprocess.Popen(words, stdin=subprocess.DEVNULL, start_new_session=True)

    def cut_power(self) -> None:
        """Kill it: neither Linux nor qemu can do anything about it, and what was not flushed is lost by chance."""
        assert self._process is not None
        self._process.kill()
        self._process.wait()
        self._process = None
        self.disk.wait_until_cut(CUT_S)

    @property
    def is_on(self) -> bool:
        """Whether it runs."""
        return self._process is not None and self._process.poll() is None

    def kill(self) -> None:
        """End it from another thread than that which uses it; that one then finds it off."""
        self._for_good = True
        if self._process is not None:
            self._process.kill()

    def close(self) -> None:
        """Switch it off for good."""
        if self._process is not None:
            self.cut_power()
        self.disk.close()

    def seconds(self) -> float:
        """Since it was switched on."""
        return time.monotonic() - self.started_at

    def need_on(self) -> None:
        """Raises ImageError if it has gone off by itself; the text has its last words."""
        if not self.is_on:
            raise ImageError("the machine has gone off by itself:\n" + "\n".join(self.console.splitlines()[-20:]))

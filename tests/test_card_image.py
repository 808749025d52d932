"""The image of an SD card: what builder and trial are made of; `make image` and `make image-test` do the rest."""

from __future__ import annotations

import contextlib
import gzip
import os
import pty
import select
import shutil
import socket
import struct
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tools.card_image import base, drivers, neighbour, partitions
from tools.card_image.base import FILES, ImageError
from tools.card_image.card import DATA, SIGNATURE, plain_kernel
from tools.card_image.forgetful_disk import SECTOR, ForgetfulDisk, Moment
from tools.card_image.set_up_trial import found_in, own_address
from tools.card_image.shell import Shell

MIB = 1 << 20
SIZE = 4 * MIB


def test_partitions_are_aligned_and_read_as_they_were_written() -> None:
    laid = partitions.lay_out([(partitions.FAT32_LBA, 1), (partitions.LINUX, 5 * MIB), (partitions.LINUX, 4 * MIB)])
    assert [(one.start // MIB, one.size // MIB) for one in laid] == [(4, 4), (8, 8), (16, 4)]
    sector = partitions.table(laid, SIGNATURE)
    assert len(sector) == SECTOR
    assert partitions.read(sector) == (SIGNATURE, laid)


@pytest.mark.skipif(shutil.which("sfdisk") is None, reason="no sfdisk here: apt-get install fdisk")
def test_sfdisk_reads_the_same_table(tmp_path: Path) -> None:
    card = tmp_path / "card"
    laid = partitions.lay_out([(partitions.FAT32_LBA, MIB), (partitions.LINUX, MIB)])
    card.write_bytes(partitions.table(laid, SIGNATURE).ljust(16 * MIB, b"\0"))
    said = subprocess.run(["sfdisk", "--dump", str(card)], capture_output=True, text=True, check=True).stdout
    assert f"label-id: 0x{SIGNATURE:08x}" in said
    assert "start=        8192, size=        8192, type=c" in said
    assert "start=       16384, size=        8192, type=83" in said


@pytest.mark.parametrize(
    ("laid", "words"),
    [
        ([partitions.Partition(0x83, 4 * MIB, 4 * MIB), partitions.Partition(0x83, 6 * MIB, MIB)], "overlaps"),
        ([partitions.Partition(0x83, 100, MIB)], "overlaps"),
        ([partitions.Partition(0x83, 1 << 42, MIB)], "2 TB"),
    ],
)
def test_a_table_that_makes_no_sense_is_refused(laid: list[partitions.Partition], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        partitions.table(laid, SIGNATURE)


def test_more_than_four_partitions_or_none_of_a_size_are_refused() -> None:
    with pytest.raises(ValueError, match="5 are wanted"):
        partitions.lay_out([(0x83, 1)] * 5)
    with pytest.raises(ValueError, match="0 octets"):
        partitions.lay_out([(0x83, 0)])
    with pytest.raises(ValueError, match="no MBR"):
        partitions.read(bytes(512))


def test_the_mirror_is_the_one_of_this_computer() -> None:
    targets = "http://a/x/ bookworm Debian\nhttp://b/ stable Other\nhttp://c/s/ bookworm-security Debian\n"
    assert base.mirrors(targets) == ("http://a/x/", "http://c/s/")
    assert base.mirrors("http://a/debian/ bookworm Debian") == ("http://a/debian/", "http://a/debian-security")
    with pytest.raises(ImageError, match="no source of Debian"):
        base.mirrors("http://b/ stable Other\n\n")
    assert base.sources("http://a", "http://s")[2] == "deb http://s bookworm-security main non-free-firmware"


def test_a_kernel_that_is_wrapped_for_efi_is_unwrapped() -> None:
    packed = gzip.compress(b"the kernel")
    head = b"MZ\0\0zimg" + struct.pack("<II", 64, len(packed)) + bytes(8) + b"gzip".ljust(32, b"\0")
    assert plain_kernel(head.ljust(64, b"\0") + packed) == b"the kernel"
    assert plain_kernel(b"MZ\x40\xfa and so on") == b"MZ\x40\xfa and so on"
    with pytest.raises(ImageError, match="zstd22"):
        plain_kernel(head.replace(b"gzip", b"zstd22")[:64] + packed)


def test_what_has_to_stay_is_on_the_data_partition() -> None:
    mounts = [line.split() for line in (FILES / "root/etc/fstab").read_text().splitlines() if line and line[0] != "#"]
    assert {(one[0], one[1]) for one in mounts if one[2] == "none"} == {
        (f"/data/{name}", f"/{seen}") for name, seen in DATA.items() if seen
    }
    assert all("nofail" in one[3] for one in mounts)


def test_a_service_that_the_page_may_ask_listens_for_the_robots_user_alone() -> None:
    text = (FILES / "root/usr/lib/systemd/system/msbot-card-serve.socket").read_text()
    assert "SocketUser=msbot" in text
    assert "SocketMode=0600" in text


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here: apt-get install systemd")
def test_systemd_finds_no_mistake_in_the_units_of_the_card(tmp_path: Path) -> None:
    for path in (FILES / "root/usr/lib/systemd/system").iterdir():
        shutil.copy(path, tmp_path)
    units = sorted(map(str, tmp_path.iterdir()))
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", *units], capture_output=True, text=True, check=False
    )
    assert [line for line in done.stderr.splitlines() if "msbot-card" in line] == []


@pytest.mark.skipif(shutil.which("dtc") is None, reason="no dtc here: apt-get install device-tree-compiler")
@pytest.mark.parametrize("path", sorted((FILES / "overlays").glob("*.dts")), ids=lambda path: path.stem)
def test_an_overlay_compiles(path: Path, tmp_path: Path) -> None:
    made = tmp_path / "made.dtbo"
    subprocess.run(["dtc", "-@", "-q", "-I", "dts", "-O", "dtb", "-o", str(made), str(path)], check=True)
    assert made.read_bytes()[:4] == b"\xd0\x0d\xfe\xed"


# The disk that forgets.


class Client:
    """An NBD client, as much as qemu does."""

    def __init__(self, place: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.connect(str(place))
        magic, option, _ = struct.unpack(">QQH", self._read(18))
        assert (magic, option) == (0x4E42444D41474943, 0x49484156454F5054)
        self._socket.sendall(struct.pack(">I", 3))
        self._option(3)  # a list of exports, which is not known
        assert struct.unpack(">QIII", self._read(20))[2] == 0x80000001
        self._option(7, struct.pack(">IH", 0, 0))
        assert struct.unpack(">QIII", self._read(20))[2:] == (3, 12)
        _, self.size, _ = struct.unpack(">HQH", self._read(12))
        assert struct.unpack(">QIII", self._read(20))[2:] == (1, 0)

    def _option(self, number: int, content: bytes = b"") -> None:
        self._socket.sendall(struct.pack(">QII", 0x49484156454F5054, number, len(content)) + content)

    def _read(self, length: int) -> bytes:
        return self._socket.recv(length, socket.MSG_WAITALL)

    def begin(self, kind: int, start: int, length: int, content: bytes = b"", *, flags: int = 0) -> None:
        """A request, whose answer is not waited for."""
        self._socket.sendall(struct.pack(">IHHQQI", 0x25609513, flags, kind, 7, start, length) + content)

    def ask(self, kind: int, start: int, length: int, content: bytes = b"", *, flags: int = 0) -> int:
        """A request; returns the error."""
        self.begin(kind, start, length, content, flags=flags)
        return self.answered()

    def answered(self) -> int:
        """The answer's error."""
        magic, error, handle = struct.unpack(">IIQ", self._read(16))
        assert (magic, handle) == (0x67446698, 7)
        return int(error)

    def write(self, start: int, content: bytes, *, flags: int = 0) -> None:
        assert self.ask(1, start, len(content), content, flags=flags) == 0

    def read(self, start: int, length: int) -> bytes:
        assert self.ask(0, start, length) == 0
        return self._read(length)

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[tuple[ForgetfulDisk, Path]]:
    file = tmp_path / "file"
    file.write_bytes(bytes(SIZE))
    disk = ForgetfulDisk(file, tmp_path / "socket", seed=3)
    yield disk, tmp_path
    disk.close()


def test_what_was_flushed_is_kept_and_of_the_rest_chance_keeps_some(disk: tuple[ForgetfulDisk, Path]) -> None:
    disk_itself, folder = disk
    client = Client(folder / "socket")
    assert client.size == SIZE
    client.write(0, b"a" * 4096)
    assert client.ask(3, 0, 0) == 0
    client.write(0, b"b" * SECTOR)
    client.write(8192, b"c" * 64 * SECTOR)
    client.write(MIB, b"d" * SECTOR, flags=1)  # FUA: this one alone
    assert client.ask(6, 4096 - SECTOR, SECTOR) == 0  # zeroes
    assert client.read(0, 1024) == b"b" * SECTOR + b"a" * SECTOR
    assert client.read(4096 - SECTOR, SECTOR) == bytes(SECTOR)
    client.close()
    disk_itself.wait_until_cut(60)
    content = (folder / "file").read_bytes()
    assert content[SECTOR : 4096 - SECTOR] == b"a" * (4096 - 2 * SECTOR)
    assert content[MIB : MIB + SECTOR] == b"d" * SECTOR
    late = [content[start : start + SECTOR] for start in range(8192, 8192 + 64 * SECTOR, SECTOR)]
    assert set(late) == {b"c" * SECTOR, bytes(SECTOR)}
    assert disk_itself.lost + disk_itself.kept == 66
    assert disk_itself.flushes == 1


def test_a_machine_finds_the_disk_again_after_a_cut(disk: tuple[ForgetfulDisk, Path]) -> None:
    disk_itself, folder = disk
    for letter in (b"x", b"y"):
        client = Client(folder / "socket")
        client.write(0, letter * SECTOR)
        assert client.ask(3, 0, 0) == 0
        client.close()
        disk_itself.wait_until_cut(60)
        assert (folder / "file").read_bytes()[:SECTOR] == letter * SECTOR


def test_a_request_beyond_the_end_is_an_error(disk: tuple[ForgetfulDisk, Path]) -> None:
    client = Client(disk[1] / "socket")
    assert client.ask(0, SIZE, SECTOR) == 22
    assert client.ask(0, 100, SECTOR) == 22
    assert client.ask(9, 0, SECTOR) == 22
    client.close()


def test_the_initramfs_gets_the_drivers_that_the_boards_name() -> None:
    trees = ['mmc { compatible = "brcm,bcm2711-emmc2\\0other"; };', 'x { compatible = "brcm,sound"; };']
    aliases = (
        "alias of:N*T*Cbrcm,bcm2711-emmc2C* sdhci_iproc\nalias of:N*T*Cbrcm,bcm2711-emmc2 sdhci_iproc\n"
        "alias of:N*T*Cbrcm,sound snd_x\nalias of:N*T*Cbrcm,bcm9999 sdhci_other\nalias pci:v1 sdhci_pci\n"
    )
    places = "kernel/drivers/mmc/host/sdhci-iproc.ko.xz: kernel/x\nkernel/sound/snd-x.ko.xz:\n"
    places += "kernel/drivers/mmc/sdhci-other.ko.xz:\n"
    assert drivers.compatibles(trees) == {"brcm,bcm2711-emmc2", "other", "brcm,sound"}
    assert drivers.drivers(aliases, places, drivers.compatibles(trees)) == ["sdhci_iproc"]


@pytest.mark.parametrize("moment", [Moment.WRITE, Moment.FLUSH])
def test_the_power_goes_in_a_write_or_before_a_flush(moment: Moment, disk: tuple[ForgetfulDisk, Path]) -> None:
    """The machine is never told that it is done, and of what it has written since the last flush a part is lost."""
    disk_itself, folder = disk
    client = Client(folder / "socket")
    disk_itself.stop_at(moment, 33)
    client.write(0, b"a" * 32 * SECTOR)
    assert client.ask(3, 0, 0) == 0  # too few sectors
    if moment is Moment.FLUSH:
        client.write(MIB, b"b" * 64 * SECTOR)
        client.begin(3, 0, 0)
    else:
        client.begin(1, MIB, 64 * SECTOR, b"b" * 64 * SECTOR, flags=1)
    assert disk_itself.wait_until_stopped(60)
    client.close()
    disk_itself.wait_until_cut(60)
    content = (folder / "file").read_bytes()
    assert content[: 32 * SECTOR] == b"a" * 32 * SECTOR
    late = [content[start : start + SECTOR] for start in range(MIB, MIB + 64 * SECTOR, SECTOR)]
    assert set(late) == {b"b" * SECTOR, bytes(SECTOR)}
    assert disk_itself.lost == late.count(bytes(SECTOR))
    again = Client(folder / "socket")  # and it is a disk as before
    again.write(0, b"c" * SECTOR)
    assert again.ask(3, 0, 0) == 0
    again.close()


@pytest.mark.parametrize("moment", [Moment.WRITE, Moment.FLUSH])
def test_what_would_be_left_is_kept_and_the_machine_goes_on(moment: Moment, disk: tuple[ForgetfulDisk, Path]) -> None:
    disk_itself, folder = disk
    client, left = Client(folder / "socket"), folder / "left"
    client.write(MIB, b"a" * SECTOR)
    assert client.ask(3, 0, 0) == 0
    disk_itself.leave_at(moment, 64, left, MIB)
    client.write(0, b"x" * SECTOR)  # before the partition
    if moment is Moment.FLUSH:
        client.write(MIB + SECTOR, b"b" * 64 * SECTOR)
        client.begin(3, 0, 0)
    else:
        client.begin(1, MIB + SECTOR, 64 * SECTOR, b"b" * 64 * SECTOR)
    assert disk_itself.wait_until_stopped(60)
    content = left.read_bytes()
    assert len(content) == SIZE - MIB
    assert content[:SECTOR] == b"a" * SECTOR
    assert set(content[SECTOR : 65 * SECTOR]) == {0, ord("b")}
    disk_itself.go_on()
    assert client.answered() == 0
    assert client.read(MIB + SECTOR, 64 * SECTOR) == b"b" * 64 * SECTOR
    client.close()
    disk_itself.wait_until_cut(60)


# Who looks at the virtual computer from outside.


def test_a_neighbour_asks_for_a_name_and_understands_the_answer() -> None:
    asked = neighbour.frame(neighbour.question("robot-7.local"))
    assert asked[:6] == bytes.fromhex("3333000000fb")
    packet = asked[14:]
    pseudo = packet[8:40] + struct.pack(">II", len(packet) - 40, 17)
    assert neighbour.checksum(pseudo + packet[40:]) == 0  # RFC 1071: the sum over all with its checksum
    address = own_address("52:54:00:00:00:01")
    assert str(address) == "fe80::5054:ff:fe00:1"
    name = b"\x07robot-7\x05local\x00"
    message = struct.pack(">HHHHHH", 0, 0x8400, 0, 2, 0, 0) + name + struct.pack(">HHIH", 1, 0x8001, 120, 4) + bytes(4)
    message += b"\xc0\x0c" + struct.pack(">HHIH", 28, 0x8001, 120, 16) + address.packed
    answer = asked[:54] + struct.pack(">HHHH", 5353, 5353, len(message) + 8, 0) + message
    assert neighbour.answers(answer, "Robot-7.local") == {address}
    assert neighbour.answers(answer, "robot-8.local") == set()
    assert neighbour.answers(asked, "robot-7.local") == set()  # a question
    loop = message[:12] + b"\xc0\x0c" + message[14:]
    for damaged in (answer[:90], answer[:62], b"", asked[:54] + answer[54:62] + loop):
        assert neighbour.answers(damaged, "robot-7.local") == set()


def test_a_command_in_the_machine_has_its_words_and_its_status(tmp_path: Path) -> None:
    """A shell behind a terminal stands for that of the machine."""
    listening = socket.socket(socket.AF_UNIX)
    listening.bind(str(tmp_path / "socket"))
    listening.listen()
    inside, outside = pty.openpty()
    bash = subprocess.Popen(["bash", "--norc"], stdin=outside, stdout=outside, stderr=outside, start_new_session=True)

    def pump() -> None:
        connection, _ = listening.accept()
        with connection, contextlib.suppress(BrokenPipeError):  # the prompt may come after the last answer was read
            while True:
                ready, _, _ = select.select([connection.fileno(), inside], [], [])
                if inside in ready:
                    connection.sendall(os.read(inside, 4096))
                if connection.fileno() in ready:
                    if not (piece := connection.recv(4096)):
                        return
                    os.write(inside, piece)

    thread = threading.Thread(target=pump)
    thread.start()
    one = Shell(tmp_path / "socket")
    try:
        one.open(60)
        assert one.run("printf 'a\\nb'; echo c >&2") == "a\nbc"
        assert one.ask("echo no; (exit 3)") == (3, "no")
        with pytest.raises(ImageError, match="fails with 3: no"):
            one.run("echo no; (exit 3)")
        assert one.wait_for("echo $((tries++)); [ $tries -ge 2 ]", 60) == "1"
        with pytest.raises(ImageError, match="fails for 0 s, with 1"):
            one.wait_for("false", 0)
    finally:
        one.close()
        thread.join()
        bash.kill()
        bash.wait()
        listening.close()


def test_a_password_is_found_on_a_card_with_holes(tmp_path: Path) -> None:
    card = tmp_path / "card"
    with card.open("wb") as file:
        file.truncate(64 * MIB)
        file.seek((16 * MIB) - 3)  # where two pieces meet
        file.write(b"chalk and talk")
    assert found_in(card, b"chalk and talk")
    assert not found_in(card, b"chalk and cheese")


def test_what_the_image_needs_is_asked_for_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    base.need_programs(base.PROGRAMS, lambda name: f"/usr/bin/{name}")
    with pytest.raises(ImageError, match="apt install mmdebstrap arch-test") as error:
        base.need_programs(base.PROGRAMS, lambda name: None if name in ("mmdebstrap", "arch-test") else name)
    assert "dtc" not in str(error.value)
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    with pytest.raises(ImageError, match="made by root"):
        base.need_root()

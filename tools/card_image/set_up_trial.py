"""A first start with a set-up file, and adapters that are plugged in: what Linux on the card makes of them.

The virtual computer has beside its disk: a second Ethernet port with a neighbour who asks by multicast DNS, a USB
serial adapter (FTDI), two CAN controllers (SJA1000) on one bus, and two radios that the kernel simulates
(mac80211_hwsim), one of which is the access point. A root shell at a serial port looks at all this; nothing on the card
is changed for it.
"""

from __future__ import annotations

import ipaddress
import json
from pathlib import Path

from tools.card_image import wifi_country
from tools.card_image.base import ImageError, run
from tools.card_image.forgetful_disk import pieces
from tools.card_image.machine import Machine
from tools.card_image.neighbour import MACHINE_MAC, Neighbour
from tools.card_image.partitions import read
from tools.card_image.robot import Robot, say, wait_for
from tools.card_image.shell import Shell, line

COMPUTER, OTHER = "robot-7", "robot-8"
"""Its name by the file, and then by the page."""
TEACHER, TEACHER_PASSWORD = "grace", "a compiler of 1952"
NETWORK, WIFI_PASSWORD, COUNTRY = "School", "chalk and talk", "DE"
BITRATE = 250_000
SOURCE = "ABCD"
"""The part number of the slot AA of the sample robot."""
SET_UP = f"""name = "{COMPUTER}"
[administrator]
name = "{TEACHER}"
password = "{TEACHER_PASSWORD}"
[wifi]
country = "{COUNTRY}"
network = "{NETWORK}"
password = "{WIFI_PASSWORD}"
[hardware]
i2c = true
can = "mcp2515-16mhz"
can_bitrate = {BITRATE}
"""
ACCESS_POINT = f"""network={{
ssid="{NETWORK}"
mode=2
frequency=2412
key_mgmt=WPA-PSK
proto=RSN
pairwise=CCMP
psk="{WIFI_PASSWORD}"
}}
"""
ITS_NETWORK = "[Match]\nName=wlan1\n[Network]\nAddress=192.168.77.1/24\nDHCPServer=yes\n"
ADAPTERS = (
    "-device", "qemu-xhci", "-device", "usb-serial,chardev=board",
    "-object", "can-bus,id=bus", "-device", "kvaser_pci,canbus=bus", "-device", "kvaser_pci,canbus=bus",
)  # fmt: skip


class SetUpTrial:
    """The trial.

    Args:
        card: the card, which is written to.
        folder: for what it needs besides.
        seed: of the disk's chance.
    """

    def __init__(self, card: Path, folder: Path, seed: int) -> None:
        with card.open("rb") as file:
            _, (self._boot, *_) = read(file.read(512))
        self._card = card
        (folder / "msbot-setup.toml").write_text(SET_UP, "utf-8")
        run("mcopy", "-o", "-i", f"{card}@@{self._boot.start}", folder / "msbot-setup.toml", "::msbot-setup.toml")
        self._neighbour = Neighbour()
        words, asked = line(folder / "shell.socket")
        self._board = folder / "board"
        """What the board at the USB serial adapter gets."""
        board = ["-chardev", f"file,id=board,path={self._board}"]
        hardware = [*words, *self._neighbour.cable(), *board, *ADAPTERS]
        self.machine = Machine(card, folder, seed, hardware, asked)
        self.robot, self._shell = Robot(self.machine), Shell(folder / "shell.socket")
        self._rows: list[str] = []

    def close(self) -> None:
        """Switch everything off."""
        self._shell.close()
        self.machine.close()
        self._neighbour.close()

    def run(self) -> list[str]:
        """Do it; returns the lines of the table.

        Raises:
            ImageError: something is not as the docs say.
        """
        self.machine.switch_on()
        seconds = self.robot.wait_for_page()
        self._shell.open()
        self._saw("the first start, with a set-up file", f"the page after {seconds:.0f} s")
        mistakes = []
        for step in (self._name, self._person, self._secrets, self._hat_and_i2c, self._usb, self._can, self._wifi):
            try:
                step()
            except (ImageError, TimeoutError) as error:  # a start takes minutes: the other steps are tried all the same
                self.machine.need_on()
                mistakes.append(str(error))
                say(mistakes[-1])
        self._shell.run("sync")
        self.machine.cut_power()
        self._nothing_on_the_card()
        if mistakes:
            raise ImageError("\n".join(mistakes))
        return ["| what | seen |", "|---|---|", *self._rows]

    def _saw(self, what: str, seen: str) -> None:
        self._rows.append(f"| {what} | {seen} |")
        say(self._rows[-1])

    def _is(self, command: str, expected: str) -> None:
        if (found := self._shell.run(command)) != expected:
            raise ImageError(f"in the machine, `{command}` says {found!r} in place of {expected!r}")

    def _name(self) -> None:
        self._is("hostname", COMPUTER)
        self._resolve(COMPUTER)

    def _resolve(self, name: str) -> None:
        found = self._neighbour.resolve(f"{name}.local", 120)
        if own_address(MACHINE_MAC) not in found:
            raise ImageError(f"{name}.local is {found or 'nobody'}, and not {own_address(MACHINE_MAC)}")
        self._saw(f"`{name}.local`, asked by a neighbour", f"answered with the port's address, {min(found)}")

    def _person(self) -> None:
        """The administrator of the file is the page's, and gives the computer another name there."""
        self.robot.sign_in(TEACHER, TEACHER_PASSWORD)
        self._saw("the file's administrator", "signs in")
        self.robot.ask("PATCH", "/api/card", {"name": OTHER})
        self._is("hostname", OTHER)
        self._resolve(OTHER)

    def _secrets(self) -> None:
        self._is("ls /boot/firmware/ | grep -i setup", "msbot-setup.example.toml")
        for place, wanted in {
            "/etc/wpa_supplicant/wpa_supplicant-wlan0.conf": "600 root root",
            "/data/card/settings.json": "600 root root",
            "/data/card": "700 root root",
            "/data/msbot": "700 msbot msbot",
        }.items():
            self._is(f"stat -c '%a %U %G' {place}", wanted)
        self._saw("files with what proves the Wi-Fi's password", "mode 600, of root; the set-up file is gone")

    def _hat_and_i2c(self) -> None:
        text = self._shell.run("cat /boot/firmware/config.txt")
        for wanted in ("dtoverlay=msbot-mcp2515,oscillator=16000000", "[pi4]\ndtoverlay=msbot-i2c\n"):
            if wanted not in text:
                raise ImageError(f"config.txt has no {wanted!r}:\n{text}")
        self.robot.ask("PATCH", "/api/card", {"hardware": {"i2c": False}})
        self._is("grep -c i2c /boot/firmware/config.txt || true", "0")
        self.robot.ask("PATCH", "/api/card", {"hardware": {"i2c": True}})
        self._is("grep -c =msbot-i2c /boot/firmware/config.txt", "3")
        self._is("findmnt --noheadings --output OPTIONS /boot/firmware | cut -d, -f1", "ro")
        self._saw(
            "CAN hat and I2C of the file and of the page", "the firmware's lines in `config.txt`; it is `ro` again"
        )

    def _usb(self) -> None:
        """The adapter is there since the start: its rules were applied by a real event."""
        place = self._shell.wait_for("ls /dev/ttyUSB0")
        self._is(f"stat -c '%a %G' {place}", "660 dialout")
        lines = self._shell.run(f"udevadm info --query=property {place}").splitlines()
        told = dict(one.partition("=")[::2] for one in lines)
        if told.get("ID_MM_DEVICE_IGNORE") != "1" or "uaccess" not in told.get("TAGS", "").split(":"):
            raise ImageError(f"{place}: {told}")
        self._shell.run(f"runuser -u msbot -- sh -c 'stty -F {place} raw 115200 && printf hello > {place}'")
        wait_for(self.machine, lambda: self._board.read_bytes() == b"hello", "what the robot's user writes", 60)
        vendor = f"{told.get('ID_VENDOR_ID')}:{told.get('ID_MODEL_ID')}"
        self._saw(
            f"a USB serial adapter ({vendor})",
            "group dialout, 660, tag uaccess, left alone by ModemManager; the robot's user writes to it",
        )

    def _can(self) -> None:
        for name in ("can0", "can1"):
            self._shell.wait_for(f"systemctl is-active msbot-can@{name}")
            about = json.loads(self._shell.run(f"ip -json -details link show {name}"))[0]
            data = about["linkinfo"]["info_data"]
            if "UP" not in about["flags"] or data["bittiming"]["bitrate"] != BITRATE or data["restart_ms"] != 100:
                raise ImageError(f"{name}: {about}")
            driver = self._shell.run(f"basename $(readlink /sys/class/net/{name}/device/driver)")
        self._saw(f"two CAN controllers ({driver})", f"`msbot-can@` has them up at {BITRATE} bit/s")
        self._shell.wait_for("grep -q 'link can:can0' /etc/msbot/master.env")
        process = "$(systemctl show msbot-master --property MainPID --value)"
        self._shell.wait_for(f"tr '\\0' ' ' < /proc/{process}/cmdline | grep -q 'link can:can0'")
        self.robot.wait_for_page()
        part = "systemd-run --quiet --unit trial-part --uid msbot --setenv HOME=/tmp/part"
        part += f" --working-directory=/tmp/part msbot part {SOURCE} --link can:can1"
        self._shell.run(f"install -d -o msbot /tmp/part; {part}")
        wait_for(
            self.machine,
            lambda: self.robot.ask("GET", "/api/slots/AA").get("part") is not None,
            "a part over CAN",
            600,
        )
        self._shell.run("systemctl stop trial-part")
        self._saw("a part at the other controller", "joins the robot over the bus")

    def _wifi(self) -> None:
        self._shell.run(
            f"mkdir -p /run/systemd/network; printf '%s' '{ITS_NETWORK}' > /run/systemd/network/10-point.network"
        )
        self._shell.run("networkctl reload; modprobe mac80211_hwsim radios=2")
        self._shell.wait_for("systemctl is-active wpa_supplicant@wlan0")
        self._shell.run(f"printf '%s' '{ACCESS_POINT}' > /run/point.conf")
        self._shell.run("wpa_supplicant -B -D nl80211 -i wlan1 -c /run/point.conf -f /run/point.log")
        self._shell.wait_for("test $(cat /sys/class/net/wlan0/carrier) = 1")
        address = self._shell.wait_for(
            "ip -4 -oneline address show dev wlan0 scope global | grep -o '192.168.77.[0-9]*/24'"
        )
        self._shell.run("grep -q AP-STA-CONNECTED /run/point.log")
        self._shell.wait_for("journalctl --unit wpa_supplicant@wlan0 | grep -qi 'key negotiation completed'", 60)
        self._shell.run(f"printf '%s' '{Path(wifi_country.__file__).read_text('utf-8')}' > /run/country.py")
        self._shell.wait_for(f"test $(python3 /run/country.py) = {COUNTRY}", 120)
        self._saw(
            "Wi-Fi of the file, at an access point of the kernel's simulated radio",
            f"WPA2 key agreed, address {address} by DHCP; the kernel keeps to the rules of {COUNTRY}",
        )

    def _nothing_on_the_card(self) -> None:
        """No octet of the card has a password; also not where a removed file was."""
        for secret in (TEACHER_PASSWORD, WIFI_PASSWORD):
            if found_in(self._card, secret.encode()):
                raise ImageError(f"the card has the password {secret!r} somewhere")
        self._saw("passwords of the file on the whole card, read octet by octet", "none")


def own_address(mac: str) -> ipaddress.IPv6Address:
    """The link-local address that Linux makes of a port's MAC (RFC 4291, appendix A)."""
    octets = bytes.fromhex(mac.replace(":", ""))
    identifier = bytes([octets[0] ^ 2]) + octets[1:3] + b"\xff\xfe" + octets[3:]
    return ipaddress.IPv6Address(b"\xfe\x80" + bytes(6) + identifier)


def found_in(file: Path, wanted: bytes) -> bool:
    """Whether a file, which may have holes, has these octets."""
    before = b""
    with file.open("rb", buffering=0) as opened:
        for _, piece in pieces(opened):
            if wanted in before + piece:
                return True
            before = piece[-len(wanted) :]
    return False

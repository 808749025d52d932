"""What a board is connected to, read once when a program starts.

`msbot.json` lies on the board: `{"link": "can:1?bitrate=500000"}`, or `serial:1?baudrate=115200`, or
`udp:192.168.1.20:8888` with `"wifi": ["name", "password"]`, or `ws://192.168.1.20:8080` with `"token"`, an API token of
the page, besides; optionally `"key"` and `"uid"`, as hexadecimal digits.
"""

import hashlib
import json
import time

from micropython import const, schedule

from .errors import ConfigError
from .running import once

FILE = "msbot.json"


def open_for(part):
    """The link that the board's file names; its key and UID for the part."""
    try:
        with open(FILE) as file:
            settings = json.load(file)
        wrong = None if isinstance(settings, dict) else "is no JSON object"
    except OSError:
        wrong = "is missing"
    except ValueError:
        wrong = "is no JSON"
    if wrong:
        raise ConfigError(FILE + " " + wrong + ': write {"link": "can:1?bitrate=500000"} into it')
    if part.key is None and "key" in settings:
        part.key = once("keys").parse_key(settings["key"])
    if part.uid is None:
        part.uid = _uid(settings["uid"]) if "uid" in settings else _board_uid()
    return open_link(settings.get("link", ""), settings.get("wifi"), settings.get("token", ""))


def open_link(address, wifi=None, token=""):
    """Open the link for an address; raises ConfigError when there is none."""
    kind, _, rest = address.partition(":")
    place, _, options = rest.partition("?")
    try:
        options = dict([option.split("=") for option in options.split("&")] if options else ())
        if kind == "can":
            from .can import CanLink

            number, bitrate = int(place), int(options.get("bitrate", "500000"))
            try:
                return CanLink(MachineCan(number, bitrate), address)
            except ImportError:
                return CanLink(PybCan(number, bitrate), address)
        if kind == "serial":
            from machine import UART

            from .links import SerialLink

            pins = {name: int(options[name]) for name in ("tx", "rx") if name in options}
            uart = UART(int(place), int(options.get("baudrate", "115200")), rxbuf=512, **pins)
            return SerialLink(uart, address, int(options.get("address", "1")))
        if kind == "udp":
            from .links import PacketLink, UdpPipe

            if wifi:
                _join_wifi(wifi)
            host, _, port = place.rpartition(":")
            return PacketLink(UdpPipe(host, int(port)), address)
        if kind == "ws" and place.startswith("//"):
            from .websocket import TcpStream, WebSocketLink

            if not token:
                raise ConfigError("link {!r} needs a token in {}: page Admin, API tokens".format(address, FILE))
            if wifi:
                _join_wifi(wifi)
            host, _, port = place[2:].partition("/")[0].partition(":")
            port = int(port or "80")
            return WebSocketLink(lambda: TcpStream(host, port), address, token)
    except ImportError as error:
        raise ConfigError("this board cannot do {}: {}".format(address, error)) from None
    except ValueError:
        pass
    words = "link {!r}: write can:1?bitrate=500000, serial:1?baudrate=115200, udp:192.168.1.20:8888"
    words += " or ws://192.168.1.20:8080"
    raise ConfigError(words.format(address))


def _join_wifi(wifi):
    import network

    station = network.WLAN(network.STA_IF)
    station.active(True)
    station.connect(*wifi)
    for _ in range(200):
        if station.isconnected():
            return
        time.sleep_ms(100)
    raise ConfigError("the Wi-Fi {!r} cannot be joined: check name and password in {}".format(wifi[0], FILE))


def _uid(text):
    try:
        uid = bytes.fromhex(text)
    except (ValueError, TypeError):
        uid = b""
    if len(uid) != 8:
        raise ConfigError("uid {!r}: write 16 hexadecimal digits".format(text))
    return uid


def _board_uid():
    try:
        from machine import unique_id
    except ImportError:
        return None
    return hashlib.sha256(unique_id()).digest()[:8]


# Controllers, as `can` wants them. Their hardware keeps three frames, less than a millisecond of a busy bus, so frames
# are fetched whenever the interpreter can be interrupted, also while the loop sleeps or a function of the part works.

_KEPT = const(128)  # frames; beyond, new ones stay in the hardware, which loses them

_STOP = const(0x008)
_DOWN = const(0x180)
_BEACON = const(0x700)
_ASSIGN = const(0x02000000)


class _Controller:
    def __init__(self):
        self._came = []

    def recv(self):
        if not self._came:
            self._fetch()
        return self._came.pop(0) if self._came else None


class MachineCan(_Controller):
    """A controller of `machine.CAN`."""

    def __init__(self, number, bitrate):
        from machine import CAN

        super().__init__()
        self._can = CAN(number, bitrate)
        self._extended, self._remote, self._off = CAN.FLAG_EXT_ID, CAN.FLAG_RTR, CAN.STATE_BUS_OFF
        self._can.irq(self._fetch, trigger=CAN.IRQ_RX)

    def _fetch(self, _=None):
        while len(self._came) < _KEPT:
            got = self._can.recv()
            if got is None:
                break
            if not got[2] & self._remote:
                self._came.append((got[0], bool(got[2] & self._extended), bytes(got[1])))
        if self._can.state() == self._off:
            self._can.restart()

    def send(self, identifier, extended, data):
        try:
            return self._can.send(identifier, data, self._extended if extended else 0) is not None
        except OSError:  # bus-off: `_fetch` restarts the controller
            return False

    def pending(self):
        return self._can.get_counters()[5] or 0

    def listen(self, *nodes):
        mine = ((_STOP, 0x7FF, 0), (_BEACON, 0x7FF, 0)) + tuple([(_DOWN + node, 0x7FF, 0) for node in nodes])
        self._can.set_filters(mine + ((_ASSIGN, 0x1F000000, self._extended),))


class PybCan(_Controller):
    """A classic controller of `pyb.CAN` (STM32F4, F7)."""

    def __init__(self, number, bitrate):
        from pyb import CAN

        super().__init__()
        self._can = CAN(number, CAN.NORMAL, baudrate=bitrate, auto_restart=True)
        self._fetch_soon = self._fetch  # made here: an interrupt handler cannot allocate it
        self._can.rxcallback(0, self._interrupted)

    def _interrupted(self, _can, _reason):
        try:
            schedule(self._fetch_soon, None)
        except RuntimeError:  # the schedule is full, so a call of this is already in it
            pass

    def _fetch(self, _=None):
        while len(self._came) < _KEPT and self._can.any(0):
            identifier, extended, remote, _, data = self._can.recv(0)
            if not remote:
                self._came.append((identifier, extended, data))

    def send(self, identifier, extended, data):
        try:
            self._can.send(data, identifier, extframe=extended)
        except OSError:  # all mailboxes are taken
            return False
        return True

    def pending(self):
        return self._can.info()[5]

    def listen(self, *nodes):
        can = self._can
        mine = (_STOP, _BEACON) + tuple([_DOWN + node for node in nodes])
        mine += mine[-1:] * (-len(mine) & 3)  # a bank has four
        can.setfilter(0, can.MASK32, 0, (_ASSIGN, 0x1F000000), extframe=True)
        for bank in range(len(mine) // 4):
            can.setfilter(bank + 1, can.LIST16, 0, mine[4 * bank : 4 * bank + 4])

"""Two computers that can serve one robot, a database server that both reach, and parts that are told by one of them.

    robot's network 10.79.1.0/24     database's network 10.79.2.0/24
    parts .9 -- master A .1          server .9 -- master A .1
             \\- master B .2                   \\- master B .2

All four are network namespaces; every cable can be pulled. What the parts are told is read from the wire, in order:
the robot is right as long as nothing of the earlier master comes after the first packet of the later one.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import shutil
import signal
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from tests.e2e.prepared import NETWORK, NEW_NETWORK
from tests.e2e.processes import Process, run, running
from tests.registry.postgres import running_server

PORT = 8888
ROBOT_NET, DATABASE_NET = "10.79.1", "10.79.2"
HOSTS = {"a": 1, "b": 2}
PARTS = ("AA", "BB", "CC")
PATIENCE_S = 60.0
ALL_PROTOCOLS = 3


class NotPermitted(Exception):
    """This machine does not let us make networks."""


@dataclass
class Taken:
    """What one round of losing a master took, in seconds from the fault."""

    serving_s: float
    """Until the other one serves."""
    active_s: float
    """Until all parts are active again."""
    stale: int
    """Packets of the earlier master after the first of the later one: parts that were told by two."""


class Sniffer:
    """Who told the parts something, in the order of the wire."""

    def __init__(self, network: str) -> None:
        self.told: list[int] = []
        """The last number of the sender's address, for each datagram of a master."""
        self._ready = threading.Event()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._listen, args=(network,), daemon=True)
        self._thread.start()
        assert self._ready.wait(PATIENCE_S)

    def close(self) -> None:
        self._over.set()
        self._thread.join()

    def _listen(self, network: str) -> None:
        enter(network)  # this thread alone
        with socket.socket(socket.AF_PACKET, socket.SOCK_DGRAM, socket.htons(ALL_PROTOCOLS)) as sniffing:
            sniffing.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
            sniffing.bind(("robot", 0))
            sniffing.settimeout(0.1)
            self._ready.set()
            while not self._over.is_set():
                with contextlib.suppress(TimeoutError):
                    packet, (_, protocol, kind, *_rest) = sniffing.recvfrom(65535)
                    if protocol == 0x0800 and kind != socket.PACKET_OUTGOING:
                        self._take(packet)

    def _take(self, packet: bytes) -> None:
        start = 4 * (packet[0] & 15)
        if packet[9] == socket.IPPROTO_UDP and struct.unpack_from(">H", packet, start)[0] == PORT:
            self.told.append(packet[15])


@dataclass
class TwoMasters:
    """The whole arrangement."""

    folder: Path
    names: dict[str, str]
    """`a`, `b`, `parts` and `server`: their networks."""
    db: str
    sniffer: Sniffer
    first: bool
    """Whether masters and server run before other processes."""
    masters: dict[str, Process] = field(default_factory=dict)
    parts: dict[str, Process] = field(default_factory=dict)
    active: str = "a"

    @property
    def standby(self) -> str:
        return "b" if self.active == "a" else "a"

    def start(self) -> None:
        """Master A serves, B waits, all parts are active."""
        assert run("init", cwd=self.folder).returncode == 0
        self.start_master("a").wait_for("is up on")
        self.start_master("b").wait_for("standby: MSBOT_MASTER is served by")
        link = ",".join(f"udp:{ROBOT_NET}.{number}:{PORT}" for number in HOSTS.values())
        for name in PARTS:
            self.parts[name] = self.begin("parts", "part", name, "--link", link)
        self.wait_for_parts()

    def start_master(self, host: str) -> Process:
        link = f"udp:{ROBOT_NET}.{HOSTS[host]}:{PORT}"
        self.masters[host] = self.begin(host, "master", "--standby", "--no-page", "--link", link, "--db", self.db)
        if self.first:
            prefer(self.masters[host].pid)
        return self.masters[host]

    def begin(self, where: str, *arguments: str) -> Process:
        (self.folder / where).mkdir(exist_ok=True)
        return Process(*arguments, cwd=self.folder, env=self._own(where))

    def _own(self, where: str) -> dict[str, str]:
        """What differs between the computers: their network, and where they keep their files."""
        files = {"XDG_STATE_HOME": str(self.folder / f"state-{where}"), "XDG_RUNTIME_DIR": str(self.folder / where)}
        return {**files, NETWORK: self.names[where]}

    def wait_for_parts(self) -> None:
        for _ in self.parts:
            self.masters[self.active].wait_for("-> active in slot", patience_s=PATIENCE_S)

    def say(self, word: str) -> str:
        """`msbot stop` or `msbot go` at the computer whose master serves; what it answers."""
        with running(word, cwd=self.folder, env=self._own(self.active)) as saying:
            return saying.wait_for("STOP")

    def kill(self) -> Taken:
        """The serving master is killed (`kill -9`), and started again as the one that waits."""
        master = self.masters[self.active]
        taken = self._lose(lambda: os.kill(master.pid, signal.SIGKILL))
        master.end()
        self._wait_as_standby(self.start_master(self.standby))
        return self._judged(taken)

    def freeze(self) -> Taken:
        """The serving master is frozen, and thawed when the other one serves: it must not live on."""
        frozen = self.masters[self.active]
        taken = self._lose(lambda: os.kill(frozen.pid, signal.SIGSTOP))
        os.kill(frozen.pid, signal.SIGCONT)
        status = frozen.end(signal.SIGCONT)
        assert status == -signal.SIGALRM, status
        self._wait_as_standby(self.start_master(self.standby))
        return self._judged(taken)

    def cut(self) -> Taken:
        """The serving master loses the database, and nothing else: it must stop by itself."""
        lost = self.masters[self.active]
        network = self.names[self.active]
        taken = self._lose(lambda: ip("-n", network, "link", "set", "database", "down"))
        ip("-n", network, "link", "set", "database", "up")
        self._wait_as_standby(lost)
        return self._judged(taken)

    def _lose(self, fault: object) -> Taken:
        assert callable(fault)
        self.sniffer.told.clear()
        began = time.monotonic()
        fault()
        self.masters[self.standby].wait_for("is up on", patience_s=PATIENCE_S)
        serving_s = time.monotonic() - began
        self.active = self.standby
        self.wait_for_parts()
        active_s = time.monotonic() - began
        return Taken(serving_s, active_s, 0)

    def _wait_as_standby(self, master: Process) -> None:
        master.wait_for("standby: MSBOT_MASTER is served by", patience_s=PATIENCE_S)

    def _judged(self, taken: Taken) -> Taken:
        told = list(self.sniffer.told)
        later = HOSTS[self.active]
        assert later in told
        taken.stale = sum(sender != later for sender in told[told.index(later) :])
        return taken

    def close(self) -> None:
        for process in (*self.masters.values(), *self.parts.values()):
            process.end(signal.SIGKILL)
        self.sniffer.close()


@contextlib.contextmanager
def two_masters(folder: Path, programs: Path, *, first: bool = False) -> Iterator[TwoMasters]:
    """The arrangement, not started yet.

    Args:
        folder: for files.
        programs: where PostgreSQL is (`find_server`).
        first: masters and server run before other processes; for a test, not for a measurement.

    Raises:
        NotPermitted: networks cannot be made here.
    """
    names = {name: f"msbot{os.getpid()}{name}" for name in (*HOSTS, "parts", "server")}
    with contextlib.ExitStack() as stack:
        for name in names.values():
            stack.callback(remove, name)
        try:
            _cable(names)
        except (subprocess.CalledProcessError, FileNotFoundError) as error:
            raise NotPermitted(str(getattr(error, "stderr", error) or error).strip()) from error
        server = f"{DATABASE_NET}.9"
        cluster = stack.enter_context(running_server(programs, network=names["server"], host=server))
        if first:
            prefer(int(Path(cluster.partition("host=")[2], "data/postmaster.pid").read_text().split()[0]))
        db = f"postgresql://msbot@{server}/postgres"
        made = TwoMasters(folder, names, db, Sniffer(names["parts"]), first)
        stack.callback(made.close)
        yield made


def _cable(names: dict[str, str]) -> None:
    if shutil.which("ip") is None:
        raise FileNotFoundError("no command `ip`: apt install iproute2")
    for name in names.values():
        ip("netns", "add", name)
        ip("-n", name, "link", "set", "lo", "up")
    for middle, bridge, net, end in (
        ("parts", "robot", ROBOT_NET, "robot"),
        ("server", "database", DATABASE_NET, "database"),
    ):
        ip("-n", names[middle], "link", "add", bridge, "type", "bridge")
        ip("-n", names[middle], "addr", "add", f"{net}.9/24", "dev", bridge)
        ip("-n", names[middle], "link", "set", bridge, "up")
        for host, number in HOSTS.items():
            ip(
                "-n",
                names[host],
                "link",
                "add",
                end,
                "type",
                "veth",
                "peer",
                "name",
                f"to-{host}",
                "netns",
                names[middle],
            )
            ip("-n", names[middle], "link", "set", f"to-{host}", "master", bridge, "up")
            ip("-n", names[host], "addr", "add", f"{net}.{number}/24", "dev", end)
            ip("-n", names[host], "link", "set", end, "up")


def prefer(pid: int) -> None:
    """Have a process run before others: no master shall lose its lease of 2.4 s because other tests are at work."""
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, pid, -15)


def ip(*words: str) -> None:
    """Run `ip`."""
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)


def remove(network: str) -> None:
    """Remove a network, if it is there."""
    subprocess.run(["ip", "netns", "del", network], capture_output=True, check=False)


def enter(network: str) -> None:
    """Move this thread into a network."""
    with Path("/run/netns", network).open() as there:
        if ctypes.CDLL(None, use_errno=True).setns(there.fileno(), NEW_NETWORK):
            raise OSError(ctypes.get_errno(), f"cannot enter the network {network}")

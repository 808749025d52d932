"""Facts about DDS, networks, firewall and ports."""

from __future__ import annotations

import ipaddress
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from msbot.doctor.collectors.machine_facts import running_programs, target_of
from msbot.doctor.facts import DdsFacts, FirewallFacts, NetInterface, PortUse, ZenohFacts
from msbot.doctor.finding import CannotSee, Examined, NotNeeded
from msbot_agent.space import DDS, ZENOH
from msbot_agent.space.dds import load as load_dds
from msbot_agent.space.zenoh import check_files, unreachable
from msbot_agent.space.zenoh import load as load_zenoh
from msbot_agent.text.sentence import printable, said
from msbot_agent.text.untrusted_input import read_system_file
from msbot_xrce.errors import ConfigError

UP, LOOPBACK, MULTICAST = 0x1, 0x8, 0x1000
"""Flags of an interface (linux/if.h)."""
TOOL_S = 5.0
UNCONNECTED = {"tcp": "0A", "udp": "07"}
"""States in /proc/net: a TCP socket that listens, a UDP socket without a peer."""


def dds(patient: Examined) -> DdsFacts:
    """DDS, where it is wanted."""
    if patient.space.kind != DDS:
        raise NotNeeded(said("no DDS is wanted: msbot doctor --space dds"))
    path = fault = ""
    try:
        path = load_dds().path
    except ConfigError as error:
        fault = str(error)
    return DdsFacts(path, fault, os.environ.get("ROS_DOMAIN_ID", ""), missing_files(os.environ))


def missing_files(environment: Mapping[str, str]) -> tuple[str, ...]:
    """The files that CYCLONEDDS_URI names and that are not there."""
    names = [item.strip() for item in environment.get("CYCLONEDDS_URI", "").split(",")]
    paths = [name.removeprefix("file://") for name in names if name and not name.startswith("<")]
    return tuple(path for path in paths if not Path(path).exists())


def zenoh(patient: Examined) -> ZenohFacts:
    """Zenoh, where it is wanted: the library, the certificates, the routers."""
    if patient.space.kind != ZENOH:
        raise NotNeeded(said("no Zenoh is wanted: msbot doctor --space zenoh:tcp/HOST:7447"))
    tls = patient.space.tls
    try:
        load_zenoh()
    except ConfigError as error:
        return ZenohFacts(missing=str(error))
    try:
        if tls is not None:
            check_files(tls)
    except ConfigError as error:
        return ZenohFacts(certificates=str(error))
    return ZenohFacts(routers={router: unreachable(router, tls) for router in patient.space.routers})


def multicast(_: Examined) -> tuple[NetInterface, ...]:
    """The networks of this computer."""
    folder = Path("/sys/class/net")
    if not folder.is_dir():
        raise CannotSee(said("this system does not list its networks in /sys/class/net"))
    found = []
    for path in sorted(folder.iterdir()):
        try:
            flags, kind = int(read_system_file(path / "flags"), 16), int(read_system_file(path / "type"))
        except (OSError, ValueError):
            continue  # gone in the meantime
        if kind in (1, 772):  # Ethernet and what looks like it, loopback (linux/if_arp.h)
            found.append(
                NetInterface(printable(path.name), bool(flags & UP), bool(flags & MULTICAST), bool(flags & LOOPBACK))
            )
    return tuple(found)


def firewall(patient: Examined) -> FirewallFacts:
    """What a firewall lets in; only root may read it."""
    wanted = tuple((kind, port) for kind, host, port in patient.net_ports() if not _is_inside(host))
    if not wanted:
        raise NotNeeded(said("all ports are for this computer only: no firewall is in between"))
    if not sys.platform.startswith("linux"):
        raise CannotSee(said("firewalls are examined on Linux only"))
    ufw = Path("/etc/ufw/ufw.conf")
    if ufw.exists() and re.search(r"(?m)^ENABLED=yes", read_system_file(ufw)):
        rules = _run("ufw", "status") if os.geteuid() == 0 else None
        if rules is None:
            raise CannotSee(said("only root may read its rules: sudo msbot doctor"))
        return FirewallFacts("ufw", True, frozenset(ufw_ports(rules)), wanted)
    if os.geteuid() != 0:
        raise CannotSee(said("only root may read its rules: sudo msbot doctor"))
    rules = _run("nft", "--json", "list", "ruleset")
    if rules is not None:
        drops, open_ports = nft_rules(rules)
        return FirewallFacts("nft", drops, frozenset(open_ports), wanted)
    rules = _run("iptables", "-S", "INPUT")
    if rules is not None:
        drops, open_ports = iptables_rules(rules)
        return FirewallFacts("iptables", drops, frozenset(open_ports), wanted)
    raise CannotSee(said("there is neither nft nor iptables to read its rules with: sudo apt install nftables"))


def _is_inside(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _run(*command: str) -> str | None:
    """What a tool prints; None: it is not here, or it fails."""
    path = shutil.which(command[0]) or shutil.which(command[0], path="/usr/sbin:/sbin")
    if path is None:
        return None
    try:
        done = subprocess.run([path, *command[1:]], capture_output=True, text=True, timeout=TOOL_S, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout


def nft_rules(text: str) -> tuple[bool, set[tuple[str, int]]]:
    """Whether nftables drops what no rule allows, and the ports that rules allow (`nft --json list ruleset`)."""
    try:
        items = json.loads(text)["nftables"]
    except (ValueError, KeyError, TypeError):
        raise CannotSee(said("nft answers something that is no list of rules")) from None
    drops, open_ports = False, set()
    for item in items:
        chain, rule = item.get("chain", {}), item.get("rule", {})
        if chain.get("hook") == "input" and chain.get("policy") == "drop":
            drops = True
        parts = rule.get("expr", [])
        if any("accept" in part for part in parts):
            for part in parts:
                open_ports |= set(_matched(part.get("match", {})))
    return drops, open_ports


def _matched(match: Mapping[str, object]) -> Iterator[tuple[str, int]]:
    left, right = match.get("left"), match.get("right")
    payload = left.get("payload") if isinstance(left, dict) else None
    if not isinstance(payload, dict) or payload.get("field") != "dport" or match.get("op") not in ("==", "in"):
        return
    protocols = ("tcp", "udp") if payload.get("protocol") == "th" else (str(payload.get("protocol")),)
    values = right.get("set", []) if isinstance(right, dict) and "set" in right else [right]
    for value in values if isinstance(values, list) else []:
        bounds = value.get("range") if isinstance(value, dict) else (value, value)
        if isinstance(bounds, (list, tuple)) and all(isinstance(bound, int) for bound in bounds):
            yield from ((protocol, port) for protocol in protocols for port in range(bounds[0], bounds[1] + 1))


def iptables_rules(text: str) -> tuple[bool, set[tuple[str, int]]]:
    """The same for `iptables -S INPUT`."""
    drops, open_ports = False, set()
    for line in text.splitlines():
        if re.match(r"-P INPUT (DROP|REJECT)|-A INPUT -j (DROP|REJECT)", line):
            drops = True
        found = re.search(r"-p (tcp|udp) .*--dports? (\S+) .*-j ACCEPT", line)
        for part in found[2].split(",") if found else ():
            first, _, last = part.partition(":")
            open_ports |= {(found[1], port) for port in range(int(first), int(last or first) + 1)}  # type: ignore[index]
    return drops, open_ports


def ufw_ports(text: str) -> Iterator[tuple[str, int]]:
    """The ports that `ufw status` shows as allowed."""
    for port, protocol in re.findall(r"(?m)^(\d+)(?:/(tcp|udp))?\s+ALLOW", text):
        yield from ((one, int(port)) for one in ([protocol] if protocol else ["tcp", "udp"]))


def ports(patient: Examined) -> tuple[PortUse, ...]:
    """Who has the ports that the robot wants."""
    if not Path("/proc/net/tcp").exists():
        raise CannotSee(said("this system does not list its sockets in /proc/net"))
    sockets: dict[tuple[str, int], str] = {}
    for name in ("tcp", "tcp6", "udp", "udp6"):
        path = Path("/proc/net") / name
        if path.exists():
            sockets |= {
                (name[:3], port): inode for port, inode in bound_ports(read_system_file(path), UNCONNECTED[name[:3]])
            }
    owners = _owners({sockets[kind, port] for kind, _, port in patient.net_ports() if (kind, port) in sockets})
    ours = {master.pid for master in patient.masters}
    found = []
    for kind, host, port in patient.net_ports():
        inode = sockets.get((kind, port))
        pid, name = owners.get(inode, (None, "?")) if inode else (None, "")
        found.append(PortUse(kind, host, port, name, pid, is_ours=pid in ours))
    return tuple(found)


def bound_ports(text: str, state: str) -> Iterator[tuple[int, str]]:
    """`(port, inode)` of the sockets in a table of /proc/net that wait for others."""
    for line in text.splitlines()[1:]:
        words = line.split()
        if len(words) > 9 and words[3] == state:
            yield int(words[1].rpartition(":")[2], 16), words[9]


def _owners(inodes: Iterable[str]) -> dict[str, tuple[int, str]]:
    """The process of each socket, as far as this user may see."""
    wanted = {f"socket:[{inode}]": inode for inode in inodes}
    found: dict[str, tuple[int, str]] = {}
    if not wanted:
        return found
    for pid, name in running_programs():
        try:
            files = [target_of(file) for file in Path(f"/proc/{pid}/fd").iterdir()]
        except OSError:
            continue  # of another user, or ended
        for file in files:
            if file in wanted:
                found.setdefault(wanted[file], (pid, name))
    return found

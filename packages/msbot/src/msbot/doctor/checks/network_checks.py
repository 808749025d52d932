"""DDS, Zenoh, multicast, firewall, ports."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from msbot.doctor.facts import DdsFacts, FirewallFacts, NetInterface, PortUse, ZenohFacts
from msbot.doctor.finding import Finding
from msbot_agent.space import ZENOH_HERE
from msbot_agent.text.sentence import said

MOST_DOMAIN = 232
"""The highest domain whose ports exist (DDSI-RTPS 2.5 §9.6.1)."""
MOST_QUIET_DOMAIN = 101
"""Above it, the ports of a domain are among those that Linux gives to any program (ip_local_port_range)."""


def check_dds(facts: DdsFacts) -> Iterator[Finding]:
    """Whether DDS can be used."""
    if not facts.library:
        yield Finding(
            "dds-library",
            "libddsc",
            facts.fault or said("there is no DDS library"),
            said("--space dds and ROS 2 need it; topics stay in the master's process"),
            said("no RTPS packets at UDP port 7400 and above"),
            "pip install 'msbot[dds]'",
        )
    domain = facts.domain
    if domain and not (domain.isascii() and domain.isdigit() and int(domain) <= MOST_DOMAIN):
        yield Finding(
            "dds-domain",
            "ROS_DOMAIN_ID",
            said("ROS_DOMAIN_ID is {domain!r}: a domain is a number from 0 to {most}", domain=domain, most=MOST_DOMAIN),
            said("ROS 2 programs in this terminal end at once, or talk in another domain than the robot"),
            said("RTPS packets at the ports of another domain, or none"),
            "export ROS_DOMAIN_ID=0",
        )
    elif domain and int(domain) > MOST_QUIET_DOMAIN:
        yield Finding(
            "dds-domain-ports",
            "ROS_DOMAIN_ID",
            said("ROS_DOMAIN_ID is {domain}: its ports are among those that Linux gives to any program", domain=domain),
            said("now and then a program gets a port first, and a participant does not start"),
            said("participants that are announced and never answer"),
            "export ROS_DOMAIN_ID=42",
            must=False,
        )
    for name in facts.missing_files:
        yield Finding(
            "dds-configuration",
            "CYCLONEDDS_URI",
            said("CYCLONEDDS_URI names {name}, and that is not there", name=name),
            said("Cyclone DDS refuses to start"),
            said("no RTPS packets at UDP port 7400 and above"),
            "unset CYCLONEDDS_URI",
        )


def check_zenoh(facts: ZenohFacts) -> Iterator[Finding]:
    """Whether a router can be used."""
    if facts.missing:
        yield Finding(
            "zenoh-library",
            "eclipse-zenoh",
            facts.missing,
            said("--space zenoh needs it; topics stay in the master's process"),
            said("no connection to the router"),
            "pip install 'msbot[zenoh]'",
        )
    if facts.certificates:
        yield Finding(
            "zenoh-certificates",
            "zenoh",
            facts.certificates,
            said("no connection with TLS can be opened: the robot works, and other sites do not see it"),
            said("a connection to the router that ends before the handshake, or none"),
            "openssl x509 -noout -subject -enddate -in cert.pem",
        )
    answers = any(not why for why in facts.routers.values())
    for router, why in facts.routers.items():
        if why:
            yield Finding(
                "zenoh-router",
                router,
                said("no Zenoh router at {router}: {why}", router=router, why=why),
                said("other routers of the list answer and are used")
                if answers
                else said("the robot works, and other sites do not see it; it is tried again until one answers"),
                said("connections to that port that are refused or not answered"),
                "msbot router" if router == ZENOH_HERE else "msbot router router.toml",
                must=not answers,
                first=said("start the router on its own computer; is the address right?"),
            )


def check_multicast(interfaces: Sequence[NetInterface]) -> Iterator[Finding]:
    """Whether others can be discovered."""
    usable = [one for one in interfaces if one.is_up and one.multicast and not one.is_loopback]
    if usable:
        return
    others = [one for one in interfaces if not one.is_loopback]
    if others and any(one.is_up for one in others):
        names = ", ".join(one.name for one in others if one.is_up)
        name = next(one.name for one in others if one.is_up)
        saw, mend = said("no network takes multicast: {names}", names=names), f"sudo ip link set {name} multicast on"
    else:
        name = others[0].name if others else "lo"
        saw = said("no network is up but the one inside this computer")
        mend = f"sudo ip link set {name} up" if others else "nmcli device status"
    yield Finding(
        "no-multicast",
        name,
        saw,
        said("DDS and discovery find others by multicast: programs on other computers are not found"),
        said("no packets to 239.255.0.1 leave the computer"),
        mend,
    )


def check_firewall(facts: FirewallFacts) -> Iterator[Finding]:
    """Whether a firewall keeps parts out."""
    if not facts.drops:
        return
    for protocol, port in facts.wanted:
        if (protocol, port) in facts.open_ports:
            continue
        commands = {
            "nft": f"sudo nft insert rule inet filter input {protocol} dport {port} accept",
            "iptables": f"sudo iptables -I INPUT -p {protocol} --dport {port} -j ACCEPT",
            "ufw": f"sudo ufw allow {port}/{protocol}",
        }
        yield Finding(
            "firewall",
            f"{protocol} {port}",
            said(
                "the firewall ({tool}) drops what comes in at {protocol} port {port}",
                tool=facts.tool,
                protocol=protocol,
                port=port,
            ),
            said("parts and browsers of other computers cannot reach the robot there"),
            said("packets of a part that come in, and never an answer"),
            commands[facts.tool],
        )


def check_ports(uses: Sequence[PortUse]) -> Iterator[Finding]:
    """Whether another program has a port that the robot wants."""
    for use in uses:
        if not use.holder or use.is_ours:
            continue
        about = f"{use.protocol} {use.host}:{use.port}"
        who = said("a program of another user") if use.holder == "?" else f"{use.holder} ({use.pid})"
        yield Finding(
            "port-taken",
            about,
            said("{who} has {protocol} port {port}", who=who, protocol=use.protocol, port=use.port),
            said("the master ends at its start, or parts speak with a program that does not understand them"),
            said("parts ask to join, again and again; no answer, or one that makes no sense"),
            f"sudo ss -lnp 'sport = :{use.port}'" if use.pid is None else f"kill {use.pid}",
            first=said("or let the master use another port: --link udp:127.0.0.1:8889, --port 8081"),
        )

"""Every problem that the doctor knows is planted once and found; a healthy computer with its robot is silent."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import pytest

from msbot.config import NOBODY, Binding, Options, SlotPort
from msbot.doctor import Finding, Unavailable
from msbot.doctor.checks.bus_checks import check_can, check_i2c, check_serial
from msbot.doctor.checks.installation_checks import check_access, check_packages, check_python
from msbot.doctor.checks.machine_checks import check_clock, check_disk
from msbot.doctor.checks.network_checks import check_dds, check_firewall, check_multicast, check_ports, check_zenoh
from msbot.doctor.checks.robot_checks import check_robot, loops
from msbot.doctor.checks.stop_checks import check_stop
from msbot.doctor.checks.storage_checks import check_database
from msbot.doctor.facts import Device, NetInterface, OddFolder, PackageNeed, PartSeen, PortUse, ZenohFacts
from msbot.operations.arguments import read_arguments
from msbot.operations.table import OPERATIONS
from msbot_agent.link.can import BusState
from msbot_agent.link.can.adapters import CanTotals, Wanted
from tests.doctor.healthy import (
    ACCESS,
    BLUEPRINT,
    CAN,
    CAN0,
    CLOCK,
    DATABASE,
    DDS,
    DISK,
    FIREWALL,
    I2C,
    NETWORKS,
    PACKAGES,
    PORTS,
    PYTHON,
    ROBOT,
    SERIAL,
    STOP,
    WIRE,
    ZENOH,
)

Looked = Callable[[], Iterable[Finding | Unavailable]]


def can(**changes: object) -> Looked:
    """The findings about can0 with something else about it."""
    return lambda: check_can(replace(CAN, interfaces=(replace(CAN0, **changes),)))  # type: ignore[arg-type]


def robot(**changes: object) -> Looked:
    return lambda: check_robot(replace(ROBOT, **changes))  # type: ignore[arg-type]


def database(**changes: object) -> Looked:
    return lambda: check_database(replace(DATABASE, **changes))  # type: ignore[arg-type]


def place(**changes: object) -> Looked:
    return lambda: check_disk([replace(DISK[0], **changes)])  # type: ignore[arg-type]


SHUT = Device("/dev/ttyACM0", "dialout", is_usable=False)
BACK = Binding("echo", "Level", SlotPort("BB", "out"), (SlotPort("AA", "in"),))
ODD_FOLDER = OddFolder("/tmp/msbot-stop-7", is_folder=True, owner="user eve", mode=0o700)
LOST_PART = PartSeen("knob", "AA", "refused", "wrong number", "0a0b0c0d0e0f1011")

PLANTED: dict[str, tuple[str, Looked]] = {
    "python-old": ("/usr/bin/python3", lambda: check_python(replace(PYTHON, version=(3, 9, 2)))),
    "python-new": ("/usr/bin/python3", lambda: check_python(replace(PYTHON, version=(3, 15, 0)))),
    "python-32-bit": ("/usr/bin/python3", lambda: check_python(replace(PYTHON, is_64_bit=False))),
    "package-missing": ("python-can",
                        lambda: check_packages((PackageNeed("python-can", ">=4", "msbot-agent[can]", None, False),))),
    "package-version": ("click", lambda: check_packages((replace(PACKAGES[0], installed="7.0", fits=False),))),
    "group-missing": ("/dev/ttyACM0", lambda: check_access(replace(ACCESS, groups=frozenset({"ada"}),
                                                                   member_of=frozenset({"ada"}), devices=(SHUT,)))),
    "group-not-in-force": ("/dev/ttyACM0",
                           lambda: check_access(replace(ACCESS, groups=frozenset({"ada"}), devices=(SHUT,)))),
    "device-of-root": ("/dev/gpiochip0",
                       lambda: check_access(replace(ACCESS, devices=(Device("/dev/gpiochip0", "root", False),)))),
    "no-socketcan": ("can0", lambda: check_can(replace(CAN, has_socketcan=False, interfaces=()))),
    "can-missing": ("can0", lambda: check_can(replace(CAN, interfaces=()))),
    "can-down": ("can0", can(is_up=False)),
    "can-bit-rate": ("can0", can(bitrate=250_000)),
    "can-listen-only": ("can0", can(listen_only=True)),
    "can-not-as-wanted": ("can0", lambda: check_can(replace(CAN, wanted=(Wanted("can0", fd=True),)))),
    "bus-off": ("can0", can(state=BusState.OFF, transmit_errors=248, receive_errors=0)),
    "bus-off-often": ("can0", can(totals=CanTotals(bus_offs=7))),
    "nobody-acknowledges": ("can0", can(state=BusState.PASSIVE, transmit_errors=128)),
    "cannot-read": ("can0", can(state=BusState.PASSIVE, receive_errors=135)),
    "termination": ("can0", can(transmit_errors=110, receive_errors=97)),
    "no-restart": ("can0", can(restart_ms=0)),
    "port-missing": ("/dev/ttyUSB7", lambda: check_serial(replace(SERIAL, wanted=("/dev/ttyUSB7",)))),
    "port-held": ("/dev/ttyUSB0", lambda: check_serial(replace(SERIAL, held={"/dev/ttyUSB0": "minicom (412)"}))),
    "port-meddler": ("ModemManager", lambda: check_serial(replace(SERIAL, meddlers=("ModemManager",)))),
    "i2c-off": ("Raspberry Pi 4 Model B", lambda: check_i2c(replace(I2C, buses=()))),
    "i2c-stuck": ("/dev/i2c-1", lambda: check_i2c(replace(I2C, stuck=(1,)))),
    "dds-library": ("libddsc", lambda: check_dds(replace(DDS, library="", fault="DDS needs libddsc"))),
    "dds-domain": ("ROS_DOMAIN_ID", lambda: check_dds(replace(DDS, domain="forty"))),
    "dds-domain-ports": ("ROS_DOMAIN_ID", lambda: check_dds(replace(DDS, domain="150"))),
    "dds-configuration": ("CYCLONEDDS_URI", lambda: check_dds(replace(DDS, missing_files=("/etc/dds.xml",)))),
    "zenoh-library": ("eclipse-zenoh", lambda: check_zenoh(ZenohFacts(missing="it is not here"))),
    "zenoh-certificates": ("zenoh", lambda: check_zenoh(ZenohFacts(certificates="ca.pem: cannot be read"))),
    "zenoh-router": ("tcp/10.1.2.3:7447",
                     lambda: check_zenoh(ZenohFacts(routers={"tcp/10.1.2.3:7447": "Connection refused"}))),
    "no-multicast": ("eth0", lambda: check_multicast([NetInterface("eth0", True, False, False)])),
    "firewall": ("udp 8888", lambda: check_firewall(replace(FIREWALL, open_ports=frozenset()))),
    "port-taken": ("udp 0.0.0.0:8888",
                   lambda: check_ports([PortUse("udp", "0.0.0.0", 8888, "nc", 99, is_ours=False)])),
    "schema-newer": ("robot.db", database(schema=12)),
    "schema-older": ("robot.db", database(schema=4)),
    "damage": ("robot.db", database(faults=("the file is damaged: row 7",))),
    "locked": ("robot.db", database(is_locked=True)),
    "unopened": ("robot.db", database(unopened="robot.db is not a database")),
    "readable-by-others": ("robot.db", database(others_may_read=True)),
    "network-drive": ("robot.db", database(network_drive="nfs4")),
    "log-grows": ("robot.db", database(log_mb=300.0)),
    "database-large": ("robot.db", database(size_mb=3000.0)),
    "backup-old": ("robot.db", database(backup_age_s=30 * 86400.0)),
    "clock-past": ("clock", lambda: check_clock(replace(CLOCK, now_s=0.0, newest_record_s=None))),
    "clock-jumped": ("clock", lambda: check_clock(replace(CLOCK, newest_record_s=CLOCK.now_s + 4000))),
    "clock-free": ("clock", lambda: check_clock(replace(CLOCK, is_synchronised=False))),
    "stop-folder": ("msbot stop", lambda: check_stop(replace(STOP, trouble="Read-only file system"))),
    "stop-folder-odd": ("/tmp/msbot-stop-7", lambda: check_stop(replace(STOP, odd=(ODD_FOLDER,)))),
    "stop-group": ("Buggy 2", lambda: check_stop(replace(STOP, own_group="blue", groups={"Buggy 2": "red"}))),
    "disk-read-only": ("/home/ada", place(read_only=True, is_writable=False)),
    "not-writable": ("/home/ada", place(is_writable=False)),
    "disk-full": ("/home/ada", place(free_mb=20.0)),
    "disk-files": ("/home/ada", place(free_files=0.001)),
    "no-master": ("Rover", robot(is_run=False, masters=0)),
    "two-masters": ("Rover", robot(masters=2)),
    "not-stored": ("Rover", robot(not_stored="the disk is full")),
    "stopped": ("Rover", robot(stopped_by="ada")),
    "packets-lost": ("Rover", robot(lost_packets={"the queue was full": 500})),
    "slot-empty": ("BB", robot(parts=ROBOT.parts[:1])),
    "often-late": ("lamp", robot(late={"lamp": 9})),
    "many-late": ("Rover", robot(late={"lamp": 9, "knob": 4, "AA": 3})),
    "type-differs": ("BB", robot(type_differences=("BB port in: Raw of the part's program is not that",))),
    "often-refused": ("knob", robot(parts=(*ROBOT.parts, LOST_PART), refused={"knob": ("wrong number",) * 8})),
    "refused": ("knob", robot(parts=(*ROBOT.parts, LOST_PART), refused={"knob": ("wrong number",)})),
    "blocked": ("mole", robot(parts=(*ROBOT.parts, replace(LOST_PART, name="mole", slot="", uid="ff" * 8)),
                              blocked=frozenset({"ff" * 8}))),
    "key-missing": ("lamp", robot(blueprint=replace(BLUEPRINT, options=Options(authentication="key")),
                                  keys=frozenset({"0a0b0c0d0e0f1011"}))),
    "wire-fault": ("light", robot(wire_faults={"light": '"AA.out": there is no such port'})),
    "topic-unfed": ("light", robot(blueprint=replace(BLUEPRINT, bindings=(replace(WIRE, source=NOBODY),)))),
    "port-unbound": ("BB.in", robot(blueprint=replace(BLUEPRINT, bindings=()))),
    "loop": ("AA", robot(blueprint=replace(BLUEPRINT, bindings=(WIRE, BACK)))),
    "bus-load": ("Rover", robot(bus_load=0.93)),
}  # fmt: skip
"""Each problem: what it is about, and how it is planted."""

HEALTHY: dict[str, Looked] = {
    "python": lambda: check_python(PYTHON),
    "packages": lambda: check_packages(PACKAGES),
    "permissions": lambda: check_access(ACCESS),
    "can": lambda: check_can(CAN),
    "serial": lambda: check_serial(SERIAL),
    "i2c": lambda: check_i2c(I2C),
    "dds": lambda: check_dds(DDS),
    "zenoh": lambda: check_zenoh(ZENOH),
    "multicast": lambda: check_multicast(NETWORKS),
    "firewall": lambda: check_firewall(FIREWALL),
    "ports": lambda: check_ports(PORTS),
    "database": lambda: check_database(DATABASE),
    "clock": lambda: check_clock(CLOCK),
    "disk": lambda: check_disk(DISK),
    "stop": lambda: check_stop(STOP),
    "robot": lambda: check_robot(ROBOT),
}


@pytest.mark.parametrize("check", HEALTHY)
def test_nothing_is_said_about_what_is_healthy(check: str) -> None:
    assert list(HEALTHY[check]()) == []


def test_parts_of_one_name_that_were_refused_are_one_finding() -> None:
    """They are counted by name; a program that is started again can be another part each time."""
    parts = tuple(replace(LOST_PART, uid=f"{number:02x}" * 8) for number in range(3))
    (finding,) = robot(parts=(*ROBOT.parts, *parts), refused={"knob": ("wrong number",) * 8})()
    assert isinstance(finding, Finding)
    assert finding.saw == "knob was refused 8 times in the last hour: wrong number"


def test_many_parts_that_are_late_are_one_finding_and_few_among_many_are_each_their_own() -> None:
    names = [f"p{number}" for number in range(10)]
    seen = {len(late): list(robot(late=dict.fromkeys(late, 3), parts=())()) for late in (names[:2], names[:3], names)}
    kinds = {
        count: [one.problem for one in found if isinstance(one, Finding) and "late" in one.problem]
        for count, found in seen.items()
    }
    assert kinds == {2: ["often-late"] * 2, 3: ["many-late"], 10: ["many-late"]}
    words = next(one.saw for one in seen[10] if isinstance(one, Finding) and one.problem == "many-late")
    assert words == "10 parts were late often in the last hour: p0, p1, p2, p3, p4, p5, p6, p7, ..."
    others = tuple(replace(ROBOT.parts[0], name=f"q{number}") for number in range(7))
    few = robot(late=dict.fromkeys(names[:3], 3), parts=others)()
    assert [one.problem for one in few if isinstance(one, Finding) and "late" in one.problem] == ["often-late"] * 3


@pytest.mark.parametrize("problem", PLANTED)
def test_a_planted_problem_is_found(problem: str) -> None:
    about, look = PLANTED[problem]
    found = [one for one in look() if isinstance(one, Finding)]
    assert [(one.problem, one.about) for one in found] == [(problem, about)], "this one, and no other"
    (one,) = found
    assert all((one.saw, one.why, one.wire, one.mend)), "it says everything"
    assert "{" not in one.saw + one.why + one.mend


@pytest.mark.parametrize("problem", PLANTED)
def test_what_the_page_may_do_is_an_operation_or_a_backup(problem: str) -> None:
    for one in PLANTED[problem][1]():
        if isinstance(one, Finding) and one.mending is not None and one.mending.name != "backup":
            read_arguments(OPERATIONS[one.mending.name], dict(one.mending.arguments))


def test_a_clock_that_cannot_be_judged_is_not_taken_for_right() -> None:
    found = list(check_clock(replace(CLOCK, is_synchronised=Unavailable("nobody tells"))))
    assert found == [Unavailable("nobody tells")]


def test_slots_may_be_empty_while_a_robot_starts_and_nobody_calls_that_well() -> None:
    (found,) = check_robot(replace(ROBOT, parts=(), up_s=5.0))
    assert isinstance(found, Unavailable)
    assert "has only just started" in found.why


def test_every_circle_is_found_once_and_ways_without_circle_are_none() -> None:
    assert loops({"A": ["B", "C"], "B": ["C"]}) == []
    assert loops({"A": ["B"], "B": ["C"], "C": ["A"], "D": ["D"]}) == [("A", "B", "C"), ("D",)]
    assert loops({"X": ["A"], "A": ["B"], "B": ["A"]}) == [("A", "B")], "X leads to a circle and is in none"


def test_circles_of_many_wires_do_not_take_for_ever() -> None:
    names = [f"S{number}" for number in range(60)]
    assert loops({name: names for name in names}) == [(name,) for name in sorted(names)]

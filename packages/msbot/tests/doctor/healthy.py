"""The facts of a computer and a robot with which all is well; tests plant one problem at a time."""

from __future__ import annotations

from msbot.config import Binding, Blueprint, Direction, Library, PartType, Port, RobotProfile, Slot, SlotPort
from msbot.doctor.facts import (
    AccessFacts,
    CanFacts,
    ClockFacts,
    DatabaseFacts,
    DdsFacts,
    Device,
    FirewallFacts,
    I2cFacts,
    NetInterface,
    PackageNeed,
    PartSeen,
    PortUse,
    PythonFacts,
    RobotFacts,
    SerialFacts,
    StopFacts,
    WrittenFolder,
    ZenohFacts,
)
from msbot_agent.link.can import BusState
from msbot_agent.link.can.adapters import CanInterface, CanTotals, Wanted

LIBRARY = Library(
    (
        PartType("KNOB", "Knob", ports=(Port("out", Direction.PUBLISH, "Level", 10.0),)),
        PartType("LAMP", "Lamp", ports=(Port("in", Direction.SUBSCRIBE, "Level"),)),
    )
)
WIRE = Binding("light", "Level", SlotPort("AA", "out"), (SlotPort("BB", "in"),))
BLUEPRINT = Blueprint(RobotProfile("Rover"), (Slot("AA", "KNOB"), Slot("BB", "LAMP")), (WIRE,))
CAN0 = CanInterface(
    "can0",
    3,
    is_can=True,
    is_up=True,
    mtu=16,
    kind="can",
    bitrate=500_000,
    state=BusState.ACTIVE,
    restart_ms=100,
    transmit_errors=0,
    receive_errors=0,
    totals=CanTotals(),
)
PYTHON = PythonFacts((3, 11, 9), is_64_bit=True, executable="/usr/bin/python3", oldest=(3, 11), newest=(3, 13))
PACKAGES = (PackageNeed("click", ">=8.1", "", "8.2.1", fits=True),)
ACCESS = AccessFacts(
    "ada",
    frozenset({"ada", "dialout", "i2c"}),
    frozenset({"ada", "dialout", "i2c"}),
    (Device("/dev/ttyUSB0", "dialout", is_usable=True), Device("/dev/i2c-1", "i2c", is_usable=True)),
)
CAN = CanFacts(has_socketcan=True, interfaces=(CAN0,), wanted=(Wanted("can0", bitrate=500_000),))
SERIAL = SerialFacts(("/dev/ttyUSB0",), ("/dev/ttyUSB0",), {}, ())
I2C = I2cFacts("Raspberry Pi 4 Model B", (1,), ())
DDS = DdsFacts("/usr/lib/libddsc.so.11", "", "42", ())
ZENOH = ZenohFacts(routers={"tcp/127.0.0.1:7447": ""})
NETWORKS = (
    NetInterface("eth0", is_up=True, multicast=True, is_loopback=False),
    NetInterface("lo", is_up=True, multicast=False, is_loopback=True),
)
FIREWALL = FirewallFacts("nft", drops=True, open_ports=frozenset({("udp", 8888)}), wanted=(("udp", 8888),))
PORTS = (PortUse("udp", "0.0.0.0", 8888, "msbot", 77, is_ours=True), PortUse("tcp", "127.0.0.1", 8080, "", None, False))
DATABASE = DatabaseFacts("robot.db", 9, 9, size_mb=2.0, backups="backups", backup_age_s=3600.0, age_s=9e6)
CLOCK = ClockFacts(1.8e9, 1.7e9, is_synchronised=True, newest_record_s=1.8e9 - 5)
STOP = StopFacts(trouble="", odd=(), own_group="", groups={"Rover 1": "", "Buggy 2": "red"})
DISK = (WrittenFolder("database", "/home/ada", 50_000.0, 60_000.0, 0.9, is_writable=True, read_only=False),)
ROBOT = RobotFacts(
    name="Rover",
    is_run=True,
    masters=1,
    up_s=3600.0,
    stopped_by="",
    blueprint=BLUEPRINT,
    library=LIBRARY,
    parts=(
        PartSeen("knob", "AA", "active", "", "0a0b0c0d0e0f1011"),
        PartSeen("lamp", "BB", "active", "", "0a0b0c0d0e0f1012"),
    ),
    late={"knob": 1},
    refused={},
    blocked=frozenset(),
    keys=frozenset(),
    wire_faults={},
    bus_bitrate=500_000,
    bus_load=0.05,
    not_stored="",
)

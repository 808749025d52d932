"""CAN interfaces, serial ports, I2C."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from msbot.doctor.facts import CanFacts, I2cFacts, SerialFacts
from msbot.doctor.finding import Finding
from msbot_agent.link.can import BusState
from msbot_agent.link.can.adapters import CanInterface, Wanted, up_commands, why_not
from msbot_agent.text.sentence import counted, said

WARNING_AT = 96
"""From here on a controller warns (ISO 11898-1 12.1.4)."""
PASSIVE_AT = 128
MANY_BUS_OFFS = 3
MANY_WARNINGS = 10


def check_can(facts: CanFacts) -> Iterator[Finding]:
    """Whether the CAN interfaces can be used, and what their errors look like."""
    if facts.wanted and not facts.has_socketcan:
        yield Finding(
            "no-socketcan",
            ", ".join(one.name for one in facts.wanted),
            said("this kernel has no SocketCAN"),
            said("links such as can:can0 need it; adapters of python-can work without"),
            said("nothing: no frame can be sent"),
            "sudo modprobe can_raw can_dev",
        )
        return
    there = {one.name: one for one in facts.interfaces}
    for wanted in facts.wanted:
        yield from _as_wanted(wanted, there.get(wanted.name), facts)
    for one in facts.interfaces:
        if not one.is_up and one.name not in {wanted.name for wanted in facts.wanted}:
            yield Finding(
                "can-down",
                one.name,
                said("the interface {name} is down", name=one.name),
                said("no frame comes in or goes out"),
                said("nothing from this computer; the others go on"),
                up_commands(Wanted(one.name, bitrate=one.bitrate), one),
                must=False,
            )
        if one.is_up:
            yield from _health(one)


def _as_wanted(wanted: Wanted, found: CanInterface | None, facts: CanFacts) -> Iterator[Finding]:
    fault = why_not(wanted, found, list(facts.interfaces))
    if not fault:
        return
    again = up_commands(wanted, found)
    if found is not None and found.is_up:
        again = f"sudo ip link set {wanted.name} down && {again}"
        if found.listen_only:
            again += " listen-only off"
    if found is None:
        problem, wire = "can-missing", said("nothing from this computer")
        if wanted.name.startswith(("vcan", "vxcan")):
            again = f"sudo ip link add dev {wanted.name} type vcan && {again}"
    elif not found.is_up:
        problem, wire = "can-down", said("nothing from this computer; the others go on")
    elif found.listen_only:
        problem, wire = "can-listen-only", said("frames of others without an acknowledgement from here; none of ours")
    elif found.bitrate is not None and wanted.bitrate is not None and found.bitrate != wanted.bitrate:
        problem = "can-bit-rate"
        wire = said("error frames at every frame, stuff and form errors first; then nodes go error-passive and bus-off")
    else:
        problem, wire = "can-not-as-wanted", said("frames that the interface cannot send are missing")
    yield Finding(
        problem, wanted.name, fault.partition(": `")[0], said("a link that is to use it cannot work"), wire, again
    )


def _health(one: CanInterface) -> Iterator[Finding]:
    name = one.name
    down_up = f"sudo ip link set {name} down && {up_commands(Wanted(name), one)}"
    totals = one.totals
    offs = 0 if totals is None else totals.bus_offs
    if one.state is BusState.OFF:
        yield Finding(
            "bus-off",
            name,
            counted(
                max(offs, 1),
                "bus-off: the controller has left the bus after too many errors; it was off once since it is up",
                "bus-off: the controller has left the bus after too many errors; it was off {count} times since it is "
                "up",
            ),
            said("it sends and receives nothing until it is restarted: every part on this bus is lost for the robot"),
            said("error frames, then silence of this node; the others go on"),
            f"sudo ip link set {name} type can restart",
            first=said(
                "look for a short circuit between CAN-H and CAN-L, a wrong bit rate, or two nodes with one identifier"
            ),
        )
    elif one.transmit_errors is not None and one.receive_errors is not None:
        yield from _pattern(one, one.transmit_errors, one.receive_errors)
    elif one.state is BusState.PASSIVE:
        yield _reflections(name, down_up)
    if one.state is not BusState.OFF and offs >= MANY_BUS_OFFS:
        yield Finding(
            "bus-off-often",
            name,
            said("the controller was bus-off {count} times since it is up", count=offs),
            said(
                "each time all parts on the bus are lost for seconds; a loose wire or a short circuit that comes and "
                "goes does this"
            ),
            said("bursts of error frames, gaps, then beats and joins of all parts at once"),
            f"msbot bus dump can:{name}",
            first=said("move each cable and plug while this runs: who breaks it?"),
        )
    if one.kind == "can" and one.totals is not None and not one.restart_ms and one.state is not BusState.OFF:
        yield Finding(
            "no-restart",
            name,
            said("the kernel does not restart the controller after bus-off"),
            said(
                "after one short circuit the bus stays silent until somebody restarts it; MsBOT does so only where "
                "it has the right"
            ),
            said("error frames, then silence of this node for ever"),
            f"{down_up} restart-ms 100",
            must=False,
        )


def _pattern(one: CanInterface, sent: int, received: int) -> Iterator[Finding]:
    """What two error counters say together: the pattern tells the causes apart."""
    name = one.name
    down_up = f"sudo ip link set {name} down && {up_commands(Wanted(name), one)}"
    counts = said(
        "the error counters are {sent} for sending and {received} for receiving", sent=sent, received=received
    )
    if sent >= PASSIVE_AT and received < 8:
        # A sender that nobody acknowledges stops counting at 128 (ISO 11898-1 12.1.4.2, exception of rule c).
        yield Finding(
            "nobody-acknowledges",
            name,
            said("{counts}: nobody acknowledges what this node sends", counts=counts),
            said("no other node is on the bus, or all are at another bit rate, or the wire between is broken"),
            said("one frame, sent again and again without end, each time with an acknowledgement error"),
            down_up,
            first=said("is the other node powered, is CAN-H at CAN-H and CAN-L at CAN-L, are all bit rates the same?"),
        )
    elif received >= PASSIVE_AT and sent < 8:
        yield Finding(
            "cannot-read",
            name,
            said("{counts}: this node cannot read what others send", counts=counts),
            said("its bit rate differs from theirs, or its wires are exchanged"),
            said("error flags of this node in every frame of the others"),
            f"msbot bus dump can:{name}",
            first=said("compare the bit rates of all nodes, and look whether CAN-H and CAN-L are exchanged"),
        )
    elif max(sent, received) >= WARNING_AT or one.state is BusState.PASSIVE:
        yield replace(_reflections(name, down_up), saw=counts)
    elif one.totals is not None and one.totals.warnings >= MANY_WARNINGS:
        yield replace(
            _reflections(name, down_up),
            saw=said("the controller has warned {count} times of too many errors", count=one.totals.warnings),
            must=False,
        )


def _reflections(name: str, down_up: str) -> Finding:
    return Finding(
        "termination",
        name,
        said("many frames go wrong in both directions"),
        said(
            "reflections: a terminator of 120 ohms is missing or there are more than two, a stub is long, or a wire "
            "is loose; it gets worse with cable length and bit rate until the bus fails"
        ),
        said("stuff, bit and form errors at changing places, mostly in the later bits; frames are sent twice or more"),
        f"msbot bus dump can:{name}",
        first=said(
            "switch off and measure between CAN-H and CAN-L: 60 ohms is right, 120 means that one terminator is "
            "missing, 40 that there are three; then {down_up} sets the counters to 0",
            down_up=down_up,
        ),
    )


def check_serial(facts: SerialFacts) -> Iterator[Finding]:
    """Whether the serial ports can be used."""
    for port in facts.wanted:
        if port not in facts.there:
            known = ", ".join(facts.there) or said("none")
            yield Finding(
                "port-missing",
                port,
                said("there is no serial port {port}; there are {known}", port=port, known=known),
                said("the link has nothing to open; it is tried again every few seconds"),
                said("nothing"),
                "msbot hardware scan",
                first=said("plug it in, with a cable that carries data"),
            )
        elif port in facts.held:
            yield Finding(
                "port-held",
                port,
                said("{program} has {port} open", program=facts.held[port], port=port),
                said("two programs at one port take bytes from each other: messages are torn"),
                said("frames with wrong check sums, and bytes that are missing"),
                f"fuser -k {port}",
            )
    ports = [port for port in facts.there if port.startswith(("/dev/ttyUSB", "/dev/ttyACM"))]
    if ports or facts.wanted:
        for program in facts.meddlers:
            yield Finding(
                "port-meddler",
                program,
                said("{program} runs, and writes to every serial port that is plugged in", program=program),
                said(
                    "it takes boards for modems or Braille displays: they are disturbed in their first seconds, some "
                    "hang"
                ),
                said("bytes such as AT commands before the first frame, and check sums that are wrong"),
                f"sudo systemctl disable --now {program}",
            )


def check_i2c(facts: I2cFacts) -> Iterator[Finding]:
    """Whether there is I2C where it should be."""
    if "Raspberry Pi" in facts.board and not facts.buses:
        yield Finding(
            "i2c-off",
            facts.board,
            said("this is a {board}, and I2C is switched off", board=facts.board),
            said("chips at pins 3 and 5 are not found"),
            said("SDA and SCL stay high all the time"),
            "sudo raspi-config nonint do_i2c 0",
        )
    for bus in facts.stuck:
        yield Finding(
            "i2c-stuck",
            f"/dev/i2c-{bus}",
            said("I2C bus {bus} is stuck", bus=bus),
            said("no chip on it can be read or written"),
            said("SDA or SCL stays low all the time"),
            f"i2cdetect -y {bus}",
            first=said("take the power off all chips, look for a short circuit and for pull-up resistors of 4.7 kOhm"),
        )

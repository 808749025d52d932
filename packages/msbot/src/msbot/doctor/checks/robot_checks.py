"""The robot itself: who is missing, who is late, what is wired strangely."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence

from msbot.config import Direction
from msbot.doctor.facts import RobotFacts
from msbot.doctor.finding import Finding, Mending, Unavailable
from msbot.pnp import PartState
from msbot_agent.text.sentence import said

SETTLED_S = 30.0
"""After this time a part that is plugged in has joined."""
OFTEN_LATE = 3
MANY_LATE = 3
"""So many parts, and half of all, have one cause rather than one each."""
NAMED = 8
"""Parts in one sentence."""
OFTEN_REFUSED = 3
FULL, CROWDED = 1.0, 0.8
"""Above the second a bus has no room for parts that join, and for frames that are sent again."""
MANY_LOST = 10


def check_robot(facts: RobotFacts) -> Iterator[Finding | Unavailable]:
    """What is wrong with a robot."""
    yield from _master(facts)
    yield from _slots(facts)
    yield from _parts(facts)
    yield from _types(facts)
    yield from _wires(facts)
    yield from _bus(facts)


def _master(facts: RobotFacts) -> Iterator[Finding]:
    name = facts.name
    if not facts.is_run:
        yield Finding(
            "no-master",
            name,
            said("no master runs {robot}", robot=name),
            said("nobody lets parts in: each stays in its safe state"),
            said("parts ask to join, again and again; no answer"),
            "msbot master",
            must=False,
        )
    if facts.masters > 1:
        yield Finding(
            "two-masters",
            name,
            said("{count} masters on this computer run a robot named {robot}", robot=name, count=facts.masters),
            said("parts join whichever answers first, and half of the robot is missing in each"),
            said("two answers to one question; parts that change between them"),
            "msbot clients",
            first=said("end all but one"),
        )
    if facts.not_stored:
        yield Finding(
            "not-stored",
            name,
            said("changes are not stored: {why}", why=facts.not_stored),
            said("they are lost when the master ends"),
            said("nothing: the robot goes on with what it has in memory"),
            "msbot doctor --only database,disk",
        )
    if facts.stopped_by:
        yield Finding(
            "stopped",
            name,
            said("STOP holds, said by {who}", who=facts.stopped_by),
            said("no actuator moves until somebody says GO"),
            said("STOP frames twice a second; samples to actuators are held back"),
            "msbot go",
            must=False,
            first=said("look whether everybody is clear of the robot"),
        )
    for reason, count in facts.lost_packets.items():
        if count >= MANY_LOST:
            yield Finding(
                "packets-lost",
                name,
                said("{count} packets were lost: {reason}", count=count, reason=said(reason)),
                said("samples are missing, and what is reliable is sent twice"),
                said("gaps in the sequence numbers, ACKNACKs that ask for what is missing"),
                "msbot clients -v",
                must=False,
            )


def _slots(facts: RobotFacts) -> Iterator[Finding | Unavailable]:
    if not facts.is_run:
        return
    if facts.up_s < SETTLED_S:
        yield Unavailable(said("who is missing: the robot has only just started; look again in half a minute"))
        return
    filled = {part.slot for part in facts.parts if PartState(part.state).is_registered}
    for slot in facts.blueprint.slots:
        if slot.name not in filled:
            yield Finding(
                "slot-empty",
                slot.name,
                said("slot {slot} has no part; it wants {number}", slot=slot.name, number=slot.part_number),
                said("whatever it is wired to waits for it, or keeps its safe value"),
                said("no beats from it; its topics are silent"),
                f"msbot why {slot.name}",
                first=said("plug the part in, or let a simulated one stand in: msbot simulate {slot}", slot=slot.name),
                mending=Mending("simulate", {"slot": slot.name}),
            )


def _parts(facts: RobotFacts) -> Iterator[Finding]:
    late = {name: count for name, count in facts.late.items() if count >= OFTEN_LATE}
    names = ", ".join([*late][:NAMED]) + (", ..." if len(late) > NAMED else "")
    if len(late) >= MANY_LATE and 2 * len(late) >= len(facts.parts):
        yield Finding(
            "many-late",
            facts.name,
            said("{count} parts were late often in the last hour: {names}", count=len(late), names=names),
            said("so many are hardly each at fault: a computer that is too busy, or a full bus, delists them all"),
            said("gaps in the beats of most parts"),
            "uptime",
            first=said(
                "see how busy the computers and the bus are; then look at each part: msbot why {part}",
                part=next(iter(late)),
            ),
        )
    else:
        for name, count in late.items():
            yield Finding(
                "often-late",
                name,
                said("{part} was late {count} times in the last hour", part=name, count=count),
                said("beats get lost, or its program is busy for longer than a beat: next time it may be delisted"),
                said("gaps between its beats that are longer than the beat period"),
                f"msbot why {name}",
                first=said("look at its supply and cable first, then for loops and waits in its program"),
            )
    told: set[str] = set()
    for part in facts.parts:
        reasons = facts.refused.get(part.name, ())
        is_blocked = part.uid in facts.blocked
        if is_blocked and part.state == PartState.REFUSED.value:
            yield Finding(
                "blocked",
                part.name,
                said("{part} is blocked, and keeps asking to join", part=part.name),
                said("somebody has shut it out; it stays out until somebody lets it in again"),
                said("its claim, and a refusal, again and again"),
                f"msbot unblock {part.uid}",
                must=False,
                mending=Mending("unblock", {"part": part.uid}),
            )
        elif len(reasons) >= OFTEN_REFUSED and not PartState(part.state).is_registered:
            if part.name in told:  # counted by name, and another part of that name was here before
                continue
            told.add(part.name)
            yield Finding(
                "often-refused",
                part.name,
                said(
                    "{part} was refused {count} times in the last hour: {reason}",
                    part=part.name,
                    count=len(reasons),
                    reason=reasons[-1],
                ),
                said("it was plugged in and took no part in the robot")
                if PartState(part.state).is_over
                else said("it is plugged in and takes no part in the robot"),
                said("its claim, and a refusal, again and again"),
                f"msbot why {part.name}",
            )
        elif part.state == PartState.REFUSED.value and facts.is_run:
            yield Finding(
                "refused",
                part.name,
                said("{part} is refused: {reason}", part=part.name, reason=part.reason),
                said("it is plugged in and takes no part in the robot"),
                said("its claim, and a refusal"),
                f"msbot why {part.name}",
                must=False,
            )
    if facts.blueprint.options.authentication != "open":
        for part in facts.parts:
            if part.slot and part.uid not in facts.keys:
                yield Finding(
                    "key-missing",
                    part.name,
                    said("{part} has no key, and this robot wants proof", part=part.name),
                    said("it is refused the next time that it joins"),
                    said("the master asks for a proof; the part has none, and is refused"),
                    f"msbot key new {part.uid}",
                )


def _types(facts: RobotFacts) -> Iterator[Finding]:
    for line in facts.type_differences:
        part, _, words = line.partition(" ")
        yield Finding(
            "type-differs",
            part,
            said("{part}: {words}", part=part, words=words),
            said("what it says is read as something else, and so is what it hears"),
            said("samples of another length, or values that make no sense"),
            f"msbot why {part}",
            first=said("give the program's class the fields of the library's type, in the same order"),
        )


def _wires(facts: RobotFacts) -> Iterator[Finding]:
    blueprint = facts.blueprint
    for topic, fault in facts.wire_faults.items():
        yield Finding(
            "wire-fault",
            topic,
            fault,
            said("nothing can go over this wire"),
            said("no samples on this topic"),
            f"msbot unbind {topic}",
            mending=Mending("unbind", {"topic": topic}),
        )
    bound = {end for binding in blueprint.bindings for end in binding.ends}
    for binding in blueprint.bindings:
        if binding.topic in facts.wire_faults:
            continue
        if not binding.source.slot and not binding.in_dds.ros and not binding.in_dds.export:
            ends = ", ".join(map(str, binding.targets))
            yield Finding(
                "topic-unfed",
                binding.topic,
                said("nobody publishes {topic}, and {ends} wait for it", topic=binding.topic, ends=ends),
                said("they keep their safe values for ever"),
                said("readers of this topic, and no sample"),
                f"msbot bind {shlex.quote(binding.topic)} --type {shlex.quote(binding.type_name)} --from SLOT.PORT",
                must=False,
            )
    for slot in blueprint.slots:
        part_type = facts.library.get(slot.part_number)
        for port in () if part_type is None else part_type.ports:
            where = f"{slot.name}.{port.name}"
            is_bound = any(end.slot == slot.name and end.port == port.name for end in bound)
            if port.direction is Direction.SUBSCRIBE and not is_bound:
                yield Finding(
                    "port-unbound",
                    where,
                    said("{port} is bound to nothing", port=where),
                    said("it does nothing until it is wired, or driven by hand"),
                    said("no reader for this port, no sample to it"),
                    f"msbot bind TOPIC --type {shlex.quote(port.type_name)} --from SLOT.PORT --to {where}",
                    must=False,
                )
    for loop in loops(_arrows(facts)):
        around = " -> ".join((*loop, loop[0]))
        yield Finding(
            "loop",
            loop[0],
            said("the wires go in a circle: {around}", around=around),
            said("wanted in a control loop; else each answers the other for ever, and the bus fills"),
            said("samples of these slots in turn, as fast as they can"),
            f"msbot bus load  # {around}",
            must=False,
        )


def _arrows(facts: RobotFacts) -> dict[str, list[str]]:
    arrows: dict[str, list[str]] = {}
    for binding in facts.blueprint.bindings:
        if binding.source.slot:
            arrows.setdefault(binding.source.slot, []).extend(end.slot for end in binding.targets)
    return arrows


def loops(arrows: Mapping[str, Sequence[str]]) -> list[tuple[str, ...]]:
    """Circles in a graph: the shortest through each name that is in none of those before."""
    found: list[tuple[str, ...]] = []
    covered: set[str] = set()
    for start in sorted(arrows):
        circle = () if start in covered else _circle(arrows, start)
        if circle:
            found.append(circle)
            covered.update(circle)
    return found


def _circle(arrows: Mapping[str, Sequence[str]], start: str) -> tuple[str, ...]:
    """The shortest way from a name back to itself; empty: there is none."""
    ways: dict[str, tuple[str, ...]] = {}
    at_hand: list[tuple[str, ...]] = [(start,)]
    for way in at_hand:  # grows while it is gone through
        for after in arrows.get(way[-1], ()):
            if after == start:
                return way
            if after not in ways:
                ways[after] = (*way, after)
                at_hand.append(ways[after])
    return ()


def _bus(facts: RobotFacts) -> Iterator[Finding]:
    if not facts.bus_bitrate or facts.bus_load < CROWDED:
        return
    is_full = facts.bus_load >= FULL
    yield Finding(
        "bus-load",
        facts.name,
        said(
            "with a part in every slot the bus at {rate:g} kbit/s will be {load:.0%} busy",
            rate=facts.bus_bitrate / 1000,
            load=facts.bus_load,
        ),
        said(
            "that does not fit: what is less urgent never gets through"
            if is_full
            else "that leaves too little room for parts that join, and for frames that are sent again"
        ),
        said("frames without gaps; those with high identifiers come late or never"),
        "msbot bus load",
        first=said("take a higher bit rate, CAN FD, or lower rates of the ports"),
    )

"""What people change of a robot, a second time: with lists and dictionaries in place of a database.

`PlainRobot` says what every row has to be after each change, whether it is taken or refused. It is written down from
what the functions promise, without a look at how they do it; only what the configuration room says about wires and
values (`binding_faults`, `Parameter.fault`) is asked of that room.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from msbot.config import Binding, Blueprint, InDds, Library, RosOptions, Scalar, Slot, SlotPort, binding_faults
from msbot_agent.text.similar_names import instead_of
from msbot_xrce.errors import ConfigError

ORDER = ("library", "blueprint", "hand")
LEAST = {"value", "place", "block", "bind", "apply"}
"""What an undo without a number takes back."""


@dataclass
class PlainSlot:
    position: int
    part_number: str
    local_name: str
    description: str
    origin: str
    in_blueprint: bool = True
    version: int = 1


@dataclass
class Wire:
    topic: str
    slot: str
    port: str
    type_name: str
    publishes: bool
    reliable: bool
    origin: str
    in_use: bool = True

    @property
    def at(self) -> tuple[str, str, bool]:
        return self.slot, self.port, self.publishes


@dataclass
class Line:
    """One edit."""

    id: int
    robot: str
    at_ns: int
    who: str
    kind: str
    slot: str
    words: str
    before: Any
    after: Any
    undone_by: int | None = None


@dataclass
class Told:
    """What all robots of the database share."""

    blocks: dict[tuple[str, str], tuple[str, int]] = field(default_factory=dict)
    lines: list[Line] = field(default_factory=list)
    types: dict[str, Any] = field(default_factory=dict)
    """The library, as it was stored last."""


@dataclass
class PlainRobot:
    name: str
    shared: Told
    row: dict[str, object] = field(default_factory=dict)
    slots: dict[str, PlainSlot] = field(default_factory=dict)
    values: dict[tuple[str, str, str], tuple[Scalar, int, str]] = field(default_factory=dict)
    """Slot, parameter, origin -> value, since when, by whom."""
    wires: list[Wire] = field(default_factory=list)
    places: dict[str, tuple[str | None, str | None]] = field(default_factory=dict)
    """UID -> where it was last, where a person has put it."""
    moved_ns: dict[str, int] = field(default_factory=dict)

    def kept(self) -> Any:
        """Everything, to be brought back when a change is refused."""
        shared = self.shared
        own = deepcopy({name: value for name, value in vars(self).items() if name not in ("name", "shared")})
        return own, dict(shared.blocks), dict(shared.types), [(line, line.undone_by) for line in shared.lines]

    def bring_back(self, kept: Any) -> None:
        """As it was."""
        own, blocks, types, lines = kept
        vars(self).update(own)
        self.shared.blocks, self.shared.types = blocks, types
        self.shared.lines = [line for line, _ in lines]
        for line, undone_by in lines:
            line.undone_by = undone_by

    # What holds

    def in_blueprint(self) -> list[str]:
        here = [name for name, slot in self.slots.items() if slot.in_blueprint]
        return sorted(here, key=lambda name: self.slots[name].position)

    def in_force(self, slot: str) -> dict[str, tuple[Scalar, str, int, str]]:
        """Parameter -> value, origin, since when, by whom."""
        found: dict[str, tuple[Scalar, str, int, str]] = {}
        for origin in ORDER:
            for (of, name, where), (value, since, who) in self.values.items():
                if (of, where) == (slot, origin):
                    found[name] = value, origin, since, who
        return found

    def configuration(self, slot: str) -> tuple[list[tuple[object, ...]], dict[str, Scalar]]:
        ends: list[tuple[object, ...]] = [
            (wire.port, wire.topic, wire.type_name, wire.publishes, wire.reliable)
            for wire in self.wires
            if wire.slot == slot and wire.in_use
        ]
        settings: dict[str, Scalar] = {name: value for name, (value, *_) in self.in_force(slot).items()}
        part_type = self.shared.types.get(self.slots[slot].part_number)
        for port in part_type.ports if part_type else ():
            if port.safe is not None and any(end[0] == port.name and not end[3] for end in ends):
                settings |= {f"{port.name}.safe.{name}": value for name, value in port.safe.items()}
        return ends, settings

    def bindings(self, *, by_hand: bool = True) -> tuple[Binding, ...]:
        topics: dict[str, list[Wire]] = {}
        for wire in self.wires:
            if (wire.in_use if by_hand else wire.origin == "blueprint") and self.slots[wire.slot].in_blueprint:
                topics.setdefault(wire.topic, []).append(wire)
        found = []
        for topic, ends in topics.items():
            heard = tuple(SlotPort(end.slot, end.port) for end in ends if not end.publishes)
            sent = [SlotPort(end.slot, end.port) for end in ends if end.publishes] or [SlotPort("", "")]
            found += [Binding(topic, ends[0].type_name, one, heard, ends[0].reliable) for one in sent]
        return tuple(found)

    def notes(self) -> dict[tuple[str, str], str]:
        found = {
            (slot, name): f"set by hand by {who}"
            for (slot, name, of), (_, _, who) in self.values.items()
            if of == "hand"
        }
        found |= {(wire.topic, ""): "changed by hand" for wire in self.wires if wire.origin == "hand"}
        found |= {(wire.topic, ""): "changed by hand" for wire in self.wires if not wire.in_use}
        return found | {("", slot): "made by hand" for slot in self.in_blueprint() if self.slots[slot].origin == "hand"}

    def place(self, uid: str) -> tuple[str | None, str | None]:
        last, placed = self.places.get(uid, (None, None))
        here = self.in_blueprint()
        return last if last in here else None, placed if placed in here else None

    # What people do

    def set_value(self, who: str, now: int, slot: str, name: str, value: Scalar | None) -> Line:
        self._slot(slot)
        part_type = self.shared.types.get(self.slots[slot].part_number)
        known = {
            one.name: one for one in (part_type.parameters if part_type else ()) if one.name in self.in_force(slot)
        }
        if name not in known:
            raise ConfigError(f"slot {slot} has no parameter {name!r}; {instead_of(name, known)}")
        old, origin, *_ = self.in_force(slot)[name]
        if value is None and origin != "hand":
            raise ConfigError(f"{name} of slot {slot} is not set by hand: its value is the {origin}'s already")
        fault = None if value is None else known[name].fault(value)
        if fault:
            raise ConfigError(f"{name} of slot {slot}: {fault}")
        before = ("value", slot, name, self.values.get((slot, name, "hand"), (None,))[0])
        self._write(("value", slot, name, value), who, now)
        new, origin, *_ = self.in_force(slot)[name]
        unit = f" {known[name].unit}" if known[name].unit else ""
        words = f"{name} of {slot}: {_text(old)}{unit} -> {_text(new)}{unit}"
        words += f" (the {origin}'s)" if value is None else ""
        return self._line(who, now, "value", words, before, ("value", slot, name, value), slot)

    def put(
        self,
        who: str,
        now: int,
        uid: str,
        slot: str | None,
        *,
        by_hand: bool = True,
        words: str = "",
        told: Mapping[str, str | None] | None = None,
    ) -> Line:
        self._known(uid)
        after: dict[str, tuple[str | None, str | None]] = {one: (None, None) for one in self._there(slot)}
        after[uid] = slot, slot if by_hand else None
        where = "belongs in no slot" if slot is None else f"belongs in slot {slot}"
        words = words or f"{self._called(uid)} {where}"
        return self._move(who, now, after, words, slot or "", told or {})

    def swap(self, who: str, now: int, uid: str, slot: str, other: str) -> Line:
        self._known(uid)
        came_from = self.place(uid)[0]
        after: dict[str, tuple[str | None, str | None]] = {one: (None, None) for one in self._there(slot)}
        words = f"{self._called(uid)} is swapped into slot {slot}"
        if other:
            self._known(other)
            goes = None if came_from == slot else came_from
            after[other] = goes, goes
            words += f" in place of {self._called(other)}"
        after[uid] = slot, slot
        return self._move(who, now, after, words, slot, {})

    def block(self, who: str, now: int, kind: str, key: str, reason: str | None) -> Line:
        """Without a reason: let it in again."""
        what = f"part number {key}" if kind == "number" else f"part with UID {key}"
        old = self.shared.blocks.get((kind, key), ("",))[0]
        if reason is None and not old:
            raise ConfigError(f"{what} is not blocked")
        new = "" if reason is None else reason or "no reason given"
        words = f"{what} is let in again" if reason is None else f"{what} is blocked: {new}"
        self._write(("block", kind, key, new), who, now)
        return self._line(who, now, "block", words, ("block", kind, key, old), ("block", kind, key, new))

    def bind(
        self,
        who: str,
        now: int,
        topic: str,
        type_name: str,
        source: SlotPort | None,
        targets: Sequence[SlotPort],
        *,
        reliable: bool,
        move: bool,
    ) -> Line:
        ports = [(source, True)] if source is not None else []
        ports += [(target, False) for target in targets]
        if not ports:
            raise ConfigError(f"topic {topic!r}: name a port that publishes it or one that subscribes, as SLOT.port")
        leaving = {(port.slot, port.port, False) for port in targets} if move else set()
        left = sorted({one.topic for one in self.wires if one.at in leaving and one.in_use and one.topic != topic})
        before = [(topic, self._ends(topic))] + [(name, self._ends(name)) for name in left]
        for name in left:
            self._write_topic(name, self._without(name, leaving))
        ends = {end.at: replace(end, reliable=reliable) for end in self._ends(topic)}
        for port, publishes in ports:
            self._slot(port.slot)
            at = port.slot, port.port, publishes
            if at in ends:
                ends[at] = replace(ends[at], type_name=type_name, in_use=True)
            else:
                ends[at] = Wire(topic, *at[:2], type_name, publishes, reliable, "hand")
        if not left and list(ends.values()) == list(self._ends(topic)):
            raise ConfigError(f"topic {topic} joins these ports already")
        self._write_topic(topic, list(ends.values()))
        types = sorted({end.type_name for end in self._ends(topic) if end.in_use})
        if len(types) > 1:
            raise ConfigError(f'topic "{topic}" carries "{types[0]}" and "{types[-1]}": a topic has one type')
        slots = [Slot(name, self.slots[name].part_number) for name in self.in_blueprint()]
        faults = binding_faults(self.bindings(), slots, Library(self.shared.types.values()))
        if faults:
            raise ConfigError(f'topic "{topic}": {faults[0]}')
        words = f"topic {topic} joins {', '.join(str(port) for port, _ in ports)}"
        return self._line(who, now, "bind", words, ("topics", before), self._now(("topics", before)))

    def unbind(self, who: str, now: int, topic: str, port: SlotPort | None) -> Line:
        before = self._ends(topic)
        bound = [end for end in before if end.in_use]
        if not bound:
            known = sorted({wire.topic for wire in self.wires if wire.in_use})
            raise ConfigError(f"no port is bound to topic {topic!r}; {instead_of(topic, known)}")
        gone = {end.at for end in bound if port is None or (end.slot, end.port) == (port.slot, port.port)}
        if not gone:
            names = ", ".join(sorted({f"{end.slot}.{end.port}" for end in bound}))
            raise ConfigError(f"{port} is not bound to topic {topic!r}; {names} are")
        self._write_topic(topic, self._without(topic, gone))
        words = f"topic {topic} is taken away" if port is None else f"{port} is taken off topic {topic}"
        content = ("topics", [(topic, before)])
        return self._line(who, now, "bind", words, content, self._now(content))

    def undo(self, who: str, now: int, number: int | None) -> Line:
        mine = [line for line in self.shared.lines if line.robot == self.name]
        if number is None:
            left = [line for line in mine if line.undone_by is None and line.kind in LEAST]
            if not left:
                raise ConfigError("there is nothing to undo")
            line = left[-1]
        else:
            found = [line for line in mine if line.id == number]
            if not found:
                raise ConfigError(
                    f"there is no change {number} of this robot; the last ones are shown by `msbot undo --list`"
                )
            line = found[0]
            if line.undone_by is not None:
                raise ConfigError(f"change {number} ({line.words}) is undone already, by change {line.undone_by}")
        if line.before is None:
            raise ConfigError(f"change {line.id} ({line.words}) cannot be undone: change it again")
        if line.after[0] != "place" and self._now(line.after) != line.after:
            raise ConfigError(
                f"change {line.id} ({line.words}) cannot be undone: "
                "it has been changed since; undo what came later first"
            )
        self._write(line.before, who, now)
        row, again = line, False
        while row.kind == "undo" and (undone := [one for one in self.shared.lines if one.undone_by == row.id]):
            row, again = undone[0], not again
        words = f"change {row.id} {'made again' if again else 'undone'}: {row.words}"
        made = self._line(who, now, "undo", words, line.after, line.before, line.slot)
        for one in self.shared.lines:
            if one.undone_by == line.id:
                one.undone_by = None
        line.undone_by = made.id
        return made

    def forget_type(self, who: str, now: int, number: str, robots: Sequence[PlainRobot]) -> Line:
        for robot in robots:
            if any(slot.part_number == number for slot in robot.slots.values() if slot.in_blueprint):
                raise ConfigError(number)
        self.shared.types.pop(number, None)
        words = f"{number} is forgotten: the library does not know it any more"
        return self._line(who, now, "library", words, None, None)

    def apply(
        self,
        who: str,
        now: int,
        blueprint: Blueprint,
        part_types: Library,
        slot_by_hand: str,
        robots: Sequence[PlainRobot],
    ) -> Line | None:
        is_new = not self.row
        before = self._content()
        configured = {name: self.configuration(name) for name in self.slots}
        self.row = {
            "version": blueprint.robot.version,
            "released": blueprint.robot.released,
            "manufacturer": blueprint.robot.manufacturer,
            "beat_period_s": blueprint.timing.beat_period_s,
            "tick_period_s": blueprint.timing.tick_period_s,
            "life": blueprint.timing.life,
            "profile_period_s": blueprint.timing.profile_period_s,
            "explain": blueprint.options.explain,
            "free_topics": list(blueprint.options.free_topics),
            "authentication": blueprint.options.authentication,
            "in_dds": {
                **({"": asdict(blueprint.ros)} if blueprint.ros != RosOptions() else {}),
                **({" library": list(blueprint.library)} if blueprint.library else {}),
                **{one.topic: asdict(one.in_dds) for one in blueprint.bindings if one.in_dds != InDds()},
            },
        }
        named = {slot.name for slot in blueprint.slots} | {slot_by_hand}
        kept = [name for name in self.in_blueprint() if self.slots[name].origin == "hand" and name not in named]
        wanted = {slot.name: slot for slot in blueprint.slots}
        order = [*wanted, *kept]
        for slot in self.slots.values():
            slot.in_blueprint = False
        for position, name in enumerate(order):
            slot = self.slots.setdefault(name, PlainSlot(0, "", "", "", ""))
            slot.position, slot.in_blueprint = position, True
            slot.origin = "hand" if name in kept or name == slot_by_hand else "blueprint"
            if name in wanted:
                one = wanted[name]
                slot.part_number, slot.local_name, slot.description = one.part_number, one.local_name, one.description
        self.shared.types = self._types(part_types, robots)
        for name in order:
            self._apply_values(name, wanted.get(name), part_types, now)
        self._apply_wires(blueprint, order)
        for name, old in configured.items():
            if repr(self.configuration(name)) != repr(old):
                self.slots[name].version += 1
        after = self._content()
        if is_new or after == before:
            return None
        return self._line(
            who,
            now,
            "apply",
            self._applied(blueprint, slot_by_hand, before, after),
            ("apply", before),
            ("apply", after),
        )

    # How it is done

    def _types(self, part_types: Library, robots: Sequence[PlainRobot]) -> dict[str, Any]:
        needed = {slot.part_number for robot in robots for slot in robot.slots.values()}
        stay = {number: one for number, one in self.shared.types.items() if number in needed}
        return stay | {one.number: one for one in part_types}

    def _apply_values(self, name: str, slot: Slot | None, part_types: Library, now: int) -> None:
        part_type = part_types.get(self.slots[name].part_number)
        parameters = {one.name: one for one in (part_type.parameters if part_type else ())}
        wanted = {(name, one.name, "library"): one.default for one in parameters.values()}
        wanted |= {(name, key, "blueprint"): value for key, value in (slot.settings if slot else {}).items()}
        for key in [key for key in self.values if key[0] == name and key not in wanted]:
            parameter = parameters.get(key[1])
            if key[2] != "hand" or parameter is None or parameter.fault(self.values[key][0]) is not None:
                del self.values[key]
        for key, value in wanted.items():
            old = self.values.get(key)
            if old is None or old[0] != value or isinstance(old[0], bool) != isinstance(value, bool):
                self.values[key] = value, now, ""

    def _apply_wires(self, blueprint: Blueprint, order: Sequence[str]) -> None:
        wanted: dict[tuple[str, tuple[str, str, bool]], Wire] = {}
        for one in blueprint.bindings:
            for end, publishes in [
                *([(one.source, True)] if one.source.slot else []),
                *((target, False) for target in one.targets),
            ]:
                wire = Wire(one.topic, end.slot, end.port, one.type_name, publishes, one.reliable, "blueprint")
                wanted[one.topic, wire.at] = wire
        others = []
        for wire in self.wires:
            if (wire.topic, wire.at) in wanted:
                wanted[wire.topic, wire.at].in_use = wire.in_use
            elif wire.origin == "hand" and wire.slot in order:
                others.append(wire)
        held = [wire for wire in wanted.values() if wire.in_use]
        for wire in others:
            of_topic = [one for one in held if one.topic == wire.topic]
            of_port = [one for one in held if (one.slot, one.port) == (wire.slot, wire.port)]
            if not of_port and all(
                (one.type_name, one.reliable) == (wire.type_name, wire.reliable) for one in of_topic
            ):
                wanted[wire.topic, wire.at] = wire
        self.wires = list(wanted.values())

    def _applied(self, blueprint: Blueprint, slot_by_hand: str, before: Any, after: Any) -> str:
        if slot_by_hand:
            made = blueprint.slot(slot_by_hand)
            return (
                f"slot {slot_by_hand} is taken out"
                if made is None
                else f"slot {slot_by_hand} is made, for {made.part_number}"
            )
        old, new = before["slots"], after["slots"]
        ordered = (
            ("new", [name for name in new if name not in old]),
            ("gone", [name for name in old if name not in new]),
            ("changed", [name for name in different(before, after) if name in old and name in new]),
        )
        words = [
            f"{word}: {', '.join(names[:5])}" + (f" and {len(names) - 5} more" if len(names) > 5 else "")
            for word, names in ordered
            if names
        ]
        said = "; ".join(words) or "profile, timing, options or descriptions"
        return f"the blueprint of {self.name} is applied: {said}"

    def _content(self) -> Any:
        """Everything that a blueprint decides."""
        here = self.in_blueprint()
        return deepcopy(
            {
                "robot": self.row,
                "slots": {
                    name: (one.position, one.part_number, one.local_name, one.description, one.origin)
                    for name, one in ((name, self.slots[name]) for name in here)
                },
                "wires": [wire for wire in self.wires if wire.slot in here],
                "values": {key: value for key, value in self.values.items() if key[0] in here},
            }
        )

    def _slot(self, name: str) -> None:
        if name not in self.in_blueprint():
            raise ConfigError(f"there is no slot {name!r}; {instead_of(name, self.in_blueprint())}")

    def _known(self, uid: str) -> None:
        if not uid:
            raise ConfigError("a part without a UID cannot be given a place: the robot would not know it again")
        if uid not in self.places:
            raise ConfigError(f"no part with UID {uid} was ever seen here: plug it in first")

    def _called(self, uid: str) -> str:
        return f"EYE {uid}" if uid.startswith("b") else f"local {uid[:4]}"

    def _there(self, slot: str | None) -> list[str]:
        return [] if slot is None else [uid for uid, place in sorted(self.places.items()) if slot in place]

    def _ends(self, topic: str) -> list[Wire]:
        return [replace(wire) for wire in self.wires if wire.topic == topic]

    def _without(self, topic: str, gone: set[tuple[str, str, bool]]) -> list[Wire]:
        left = [replace(end, in_use=end.in_use and end.at not in gone) for end in self._ends(topic)]
        return [end for end in left if end.in_use or end.origin == "blueprint"]

    def _move(
        self,
        who: str,
        now: int,
        after: dict[str, tuple[str | None, str | None]],
        words: str,
        slot: str,
        told: Mapping[str, str | None],
    ) -> Line:
        before = {uid: self.place(uid) for uid in after} | {uid: (where, where) for uid, where in told.items()}
        self._write(("place", after), who, now)
        return self._line(who, now, "place", words, ("place", before), ("place", after), slot)

    def _write_topic(self, topic: str, ends: Sequence[Wire]) -> None:
        old = self._ends(topic)
        new = {end.at: end for end in ends}
        known = {end.at for end in old}
        self.wires = [
            new[wire.at] if wire.topic == topic else wire
            for wire in self.wires
            if wire.topic != topic or wire.at in new
        ] + [end for end in ends if end.at not in known]
        for slot in {end.slot for end in (*old, *ends) if end not in old or end not in ends}:
            self._slot(slot)
            self.slots[slot].version += 1

    def _now(self, content: Any) -> Any:
        """The same cell with its present content."""
        match content:
            case ("value", slot, name, _):
                return "value", slot, name, self.values.get((slot, name, "hand"), (None,))[0]
            case ("block", kind, key, _):
                return "block", kind, key, self.shared.blocks.get((kind, key), ("",))[0]
            case ("topics", topics):
                return "topics", [(topic, self._ends(topic)) for topic, _ in topics]
            case _:
                return "apply", self._content()

    def _write(self, content: Any, who: str, now: int) -> None:
        match content:
            case ("value", slot, name, value):
                self._slot(slot)
                if value is None:
                    self.values.pop((slot, name, "hand"), None)
                else:
                    self.values[slot, name, "hand"] = value, now, who
                self.slots[slot].version += 1
            case ("block", kind, key, reason):
                if reason:
                    self.shared.blocks[kind, key] = reason, now
                else:
                    self.shared.blocks.pop((kind, key), None)
            case ("place", places):
                for uid, place in places.items():
                    for slot in place:
                        if slot is not None:
                            self._slot(slot)
                    self.places[uid] = place
                    self.moved_ns[uid] = now
            case ("topics", topics):
                for topic, ends in topics:
                    self._write_topic(topic, [replace(end) for end in ends])
            case ("apply", wanted):
                self._go_back(deepcopy(wanted))

    def _go_back(self, content: Any) -> None:
        changed = different(self._content(), content)
        self.row = content["robot"]
        for slot in self.slots.values():
            slot.in_blueprint = False
        for name, row in content["slots"].items():
            slot = self.slots[name]
            slot.in_blueprint = True
            slot.position, slot.part_number, slot.local_name, slot.description, slot.origin = row
        self.wires = content["wires"]
        aside = {key: value for key, value in self.values.items() if not self.slots[key[0]].in_blueprint}
        self.values = aside | content["values"]
        for name in changed:
            self.slots[name].version += 1

    def _line(self, who: str, now: int, kind: str, words: str, before: Any, after: Any, slot: str = "") -> Line:
        lines = self.shared.lines
        number = lines[-1].id + 1 if lines else 1
        lines.append(Line(number, self.name, now, who, kind, slot, words, deepcopy(before), deepcopy(after)))
        return lines[-1]


def different(before: Any, after: Any) -> list[str]:
    """The slots whose part type, wires or values differ."""

    def of(content: Any, name: str) -> object:
        if name not in content["slots"]:
            return None
        wires = [wire for wire in content["wires"] if wire.slot == name]
        return content["slots"][name][1], wires, {k: v for k, v in content["values"].items() if k[0] == name}

    names = sorted({*before["slots"], *after["slots"]})
    return [name for name in names if of(before, name) != of(after, name)]


def _text(value: Scalar) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)

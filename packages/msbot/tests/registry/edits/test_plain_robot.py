"""Changes by chance to two robots of one database, beside a second, plain model of what they do.

The two have slots, parts and topics of the same names, so that what hits the wrong one is noticed; and every row is
compared after every change, so that nothing else has changed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import astuple, replace
from pathlib import Path
from random import Random
from typing import Any, TypeVar

import pytest
from sqlalchemy import Connection, select

from msbot.config import (
    Binding,
    Blueprint,
    Direction,
    InDds,
    Library,
    Options,
    PartType,
    Port,
    RosOptions,
    Scalar,
    Slot,
    SlotPort,
    Timing,
    scalar_text,
)
from msbot.pnp import Claim
from msbot.registry.blueprint import blueprint_reader, blueprint_store
from msbot.registry.configurations import read_configurations
from msbot.registry.database import statements
from msbot.registry.database.engine import make_engine, parse_address
from msbot.registry.database.tables import bindings, blocks, edits, library, parts, robots, settings, slots
from msbot.registry.edits import part_places, slot_values, undo, wires
from msbot.registry.edits import part_places as part_types
from msbot.registry.edits import undo as block_edits
from msbot.registry.edits.edit_log import Author, read_edits
from msbot.registry.records import EditRecord
from msbot_xrce.errors import ConfigError
from tests.effort import tries
from tests.registry.blueprint.test_blueprint_store import EYE, INVERT, LEG, PERIOD, PROFILE
from tests.registry.edits.plain_robot import Line, PlainRobot, Told, different

EAR = PartType(
    "EAR", "Ear", ports=(Port("sound", Direction.PUBLISH, "Sound"), Port("echo", Direction.SUBSCRIBE, "Sound"))
)
SPARE = PartType("SPARE", "in no slot")
STERN = replace(EYE, parameters=(replace(PERIOD, default=9, least=1),), compatible_with=(), source="own")
DARK = replace(EYE, ports=(EYE.ports[0], replace(EYE.ports[1], safe={"lux": 5})), parameters=(INVERT, PERIOD))
LIBRARIES = (Library([EYE, LEG, EAR]), Library([STERN, LEG, EAR, SPARE]), Library([DARK, LEG, EAR]))
NAMES = ("left", "right", "leg", "arm", "tail", "head", "neck", "nose")
PORTS = {
    "EYE": (("light", True), ("lamp", False)),
    "LEG": (("goal", False),),
    "EAR": (("sound", True), ("echo", False)),
}
UIDS = tuple(digit * 16 for digit in "abcd")
STRANGER = "9" * 16


class Twins:
    """Two robots in a database, and two plain ones."""

    def __init__(self, connection: Connection, random: Random) -> None:
        self.connection, self.random, self.now = connection, random, 1_000
        shared = Told()
        self.plain = [PlainRobot("R2", shared), PlainRobot("R3", shared)]
        self.numbers: dict[int, int] = {}
        for index in (0, 1):
            self.apply(index)
        for index in (0, 1):
            for uid in UIDS:
                local = "" if uid.startswith("b") else f"local {uid[:4]}"
                claim = Claim("EYE", local, bytes.fromhex(uid))
                slot = random.choice(self.plain[index].in_blueprint())
                statements.remember(connection, self.number(index), claim, slot, self.now)
                self.plain[index].places[uid], self.plain[index].moved_ns[uid] = (slot, None), self.now
            nameless = {"identity": "EYE/x", "uid": "", "part_number": "EYE", "local_name": "x", "state": "active"}
            here = self.number(index)
            rest = {"reason": "", "address": "", "first_seen_ns": 0, "changed_ns": 0, "robot_id": here}
            first = select(slots.c.id).where(slots.c.robot_id == here).limit(1)
            there = connection.execute(first).scalar()
            connection.execute(parts.insert().values(slot_id=there, **nameless, **rest))

    def number(self, index: int) -> int:
        if index not in self.numbers:
            found = statements.find_robot(self.connection, self.plain[index].name, PROFILE.serial_number)
            assert found is not None
            self.numbers[index] = found.id
        return self.numbers[index]

    # Changes

    def step(self) -> int:
        """One change by chance to one of them; returns which."""
        self.now += 1
        random, index = self.random, self.random.randrange(2)
        plain, who = self.plain[index], self.random.choice(("Ann", "Bob"))
        author = Author(self.number(index), who, self.now)
        slot, uid = random.choice((*NAMES[:4], *plain.in_blueprint())), random.choice((*UIDS, *UIDS, STRANGER, ""))
        octets, connection = bytes.fromhex(uid), self.connection
        often = ("value", "value", "put", "swap", "bind", "bind", "move", "move", "unbind", "undo", "undo")
        match random.choice((*often, *often, "block", "apply", "slot", "forget")):
            case "value":
                eyes = [one for one in plain.in_blueprint() if plain.slots[one].part_number == "EYE"]
                slot = random.choice((*eyes, *eyes, slot))
                name = random.choice(("period_s", "period_s", "period_s", "invert", "invert", "colour"))
                values: tuple[Scalar | None, ...] = (2, 2.5, 0.5, 90, True, False, None, None, "x")
                value = random.choice(values)
                self.both(
                    lambda: slot_values.set_value(connection, author, slot, name, value),
                    lambda: plain.set_value(who, self.now, slot, name, value),
                )
            case "put":
                where = random.choice((slot, slot, None))
                by_hand, words = random.random() < 0.7, random.choice(("", "it is said"))
                told = {
                    one: random.choice((None, *plain.in_blueprint()))
                    for one in random.sample(UIDS, 1)
                    if random.random() < 0.3
                }
                before = {bytes.fromhex(one): there for one, there in told.items()} or None
                self.both(
                    lambda: part_places.put(
                        connection, author, octets, where, words=words, by_hand=by_hand, before=before
                    ),
                    lambda: plain.put(who, self.now, uid, where, by_hand=by_hand, words=words, told=told),
                )
            case "swap":
                other = random.choice(("", *(one for one in (*UIDS, STRANGER) if one != uid)))
                self.both(
                    lambda: part_places.swap(connection, author, octets, slot, other=bytes.fromhex(other)),
                    lambda: plain.swap(who, self.now, uid, slot, other),
                )
            case "block":
                kind, key = random.choice((("uid", UIDS[0]), ("number", UIDS[0]), ("number", "EYE"), ("uid", UIDS[1])))
                reason = random.choice((None, None, "", "broken"))
                self.both(
                    lambda: (
                        block_edits.unblock(connection, author, kind, key)
                        if reason is None
                        else block_edits.block(connection, author, kind, key, reason)
                    ),
                    lambda: plain.block(who, self.now, kind, key, reason),
                )
            case "bind" | "move" as kind:
                self.bind(plain, author, move=kind == "move")
            case "unbind":
                topic = random.choice(("brightness", "glow", "noise", "new", "heat"))
                port = None if random.random() < 0.3 else self.port(plain)[0]
                if plain.wires and random.random() < 0.5:
                    wire = random.choice(plain.wires)
                    topic, port = wire.topic, SlotPort(wire.slot, wire.port)
                self.both(
                    lambda: wires.unbind(connection, author, topic, port),
                    lambda: plain.unbind(who, self.now, topic, port),
                )
            case "undo":
                newest = len(plain.shared.lines)
                number = random.choice((None, max(newest - random.randrange(8), 0)))
                self.both(lambda: undo.undo(connection, author, number), lambda: plain.undo(who, self.now, number))
            case "apply":
                self.apply(index, who)
            case "slot":
                self.apply(index, who, by_hand=True)
            case "forget":
                number_ = random.choice(("SPARE", "SPARE", "LEG", "EYE"))
                self.both(
                    lambda: part_types.forget_part_type(connection, author, number_),
                    lambda: plain.forget_type(who, self.now, number_, self.plain),
                    same_words=False,
                )
        return index

    def bind(self, plain: PlainRobot, author: Author, *, move: bool) -> None:
        random = self.random
        ends = [self.port(plain) for _ in range(random.choice((1, 2, 2, 3)))]
        source = next((end for end, publishes in ends if publishes), None)
        targets = [end for end, publishes in ends if not publishes]
        if random.random() < 0.1:
            source, targets = next(iter(targets), None), []
        topic = random.choice(("brightness", "glow", "glow", "noise", "msbot_masterTopic"))
        heard = [wire for wire in plain.wires if wire.in_use and not wire.publishes]
        if move and heard and random.random() < 0.9:  # to where nobody is, or others are
            wire = random.choice(heard)
            source, targets = None, [SlotPort(wire.slot, wire.port), *targets[: random.randrange(2)]]
            topic = random.choice(("new", "noise" if wire.type_name == "Sound" else "glow"))
            type_name = wire.type_name
        else:
            type_name = "Sound" if topic == "noise" else random.choice(("Light", "Light", "Light", "Sound"))
        reliable = random.random() < 0.5
        self.both(
            lambda: wires.bind(
                self.connection,
                author,
                topic,
                type_name=type_name,
                source=source,
                targets=targets,
                reliable=reliable,
                move=move,
            ),
            lambda: plain.bind(author.who, self.now, topic, type_name, source, targets, reliable=reliable, move=move),
        )

    def port(self, plain: PlainRobot) -> tuple[SlotPort, bool]:
        slot = self.random.choice(plain.in_blueprint())
        if self.random.random() < 0.05:
            return SlotPort(self.random.choice((slot, "none")), "wheel"), False
        port, publishes = self.random.choice(PORTS[plain.slots[slot].part_number])
        return SlotPort(slot, port), publishes

    def apply(self, index: int, who: str = "Ann", *, by_hand: bool = False) -> None:
        random, plain = self.random, self.plain[index]
        types = random.choice(LIBRARIES)
        if by_hand:  # as `operations` does it: the blueprint as it is, with one slot more or less
            now = blueprint_reader.read(self.connection, self.number(index), by_hand=False)
            slot_by_hand = random.choice(NAMES)
            left = tuple(slot for slot in now.slots if slot.name != slot_by_hand)
            made = () if slot_by_hand in plain.in_blueprint() else (Slot(slot_by_hand, "EYE", "", "made"),)
            gone = tuple(one for one in now.bindings if all(end.slot != slot_by_hand for end in one.ends))
            blueprint = replace(now, slots=(*left, *made), bindings=gone)
        else:
            slot_by_hand = ""
            blueprint = self.blueprint(plain.name)
        found: list[EditRecord | None] = []

        def really() -> EditRecord | None:
            robot, edit = undo.apply_blueprint(
                self.connection, blueprint, types, who=who, now_ns=self.now, slot_by_hand=slot_by_hand
            )
            assert robot == statements.find_robot(self.connection, plain.name, PROFILE.serial_number)
            found.append(edit)
            return edit

        self.both(really, lambda: plain.apply(who, self.now, blueprint, types, slot_by_hand, self.plain))

    def blueprint(self, name: str) -> Blueprint:
        random = self.random
        names = random.sample(NAMES, random.choice((2, 2, 4, 8, 8)))
        found = [self.slot(one) for one in names]
        free = [
            (SlotPort(slot.name, port), publishes, slot.part_number == "EAR")
            for slot in found
            for port, publishes in PORTS[slot.part_number]
            if random.random() < 0.7
        ]
        random.shuffle(free)
        made: list[Binding] = []
        for topic, is_sound in (("glow", False), ("brightness", False), ("noise", True)):
            mine = [one for one in free if one[2] is is_sound and random.random() < 0.6]
            free = [one for one in free if one not in mine]
            sources = [port for port, publishes, _ in mine if publishes][:2]
            targets = tuple(port for port, publishes, _ in mine if not publishes)
            if not targets:
                continue
            type_name, reliable = "Sound" if is_sound else "Light", random.random() < 0.7
            shown = random.choice((InDds(), InDds(), InDds(export=True), InDds(ros=True, ros_fields=(("a", "x"),))))
            made += [
                Binding(topic, type_name, source, targets, reliable, shown) for source in sources or [SlotPort("", "")]
            ]
        return Blueprint(
            replace(PROFILE, name=name, version=random.choice(("V1", "V2"))),
            tuple(found),
            tuple(made),
            random.choice((Timing("thesis", 1.0, 1.0, 4, 60.0), Timing("fast", 0.25, 0.5, 7, 1.0))),
            random.choice((Options(), Options(False, ("chat", "more"), "key"))),
            random.choice(((), ("kit", "more/kit"))),
            ros=random.choice((RosOptions(), RosOptions("r.urdf", clock=True, parameters="read"))),
        )

    def slot(self, name: str) -> Slot:
        random = self.random
        number = random.choice(("EYE", "EYE", "LEG", "EAR"))
        periods: tuple[Scalar | None, ...] = (None, 1, 3.5) if number == "EYE" else (None,)
        period = random.choice(periods)
        chosen = {} if period is None else {"period_s": period}
        return Slot(name, number, random.choice(("", f"{name}-1")), random.choice(("", "what for")), chosen)

    def both(
        self, really: Callable[[], EditRecord | None], plainly: Callable[[], Line | None], *, same_words: bool = True
    ) -> None:
        """Do it to both; what is refused is refused by both, in the same words, and has changed nothing."""
        kept = [one.kept() for one in self.plain]
        savepoint = self.connection.begin_nested()
        made, refused = _tried(really)
        if refused:
            savepoint.rollback()
        else:
            savepoint.commit()
        expected, why = _tried(plainly)
        if why:
            for one, state in zip(self.plain, kept, strict=True):
                one.bring_back(state)
        assert refused == why if same_words else bool(refused) == bool(why)
        assert (None if made is None else _told(made)) == (None if expected is None else _line(expected))

    # What is there

    def compare(self, read: Sequence[int] = (0, 1)) -> None:
        """Every row; and what is read of these robots."""
        shared, connection = self.plain[0].shared, self.connection
        numbers = {self.number(index): self.plain[index] for index in (0, 1)}
        self.compare_rows(numbers)
        assert _pairs(connection, blocks.c.kind, blocks.c.key, blocks.c.reason, blocks.c.since_ns) == [
            (*key, *value) for key, value in sorted(shared.blocks.items())
        ]
        assert [row[:3] for row in _pairs(connection, edits.c.id, edits.c.kind, edits.c.undone_by)] == [
            (line.id, line.kind, line.undone_by) for line in shared.lines
        ]
        assert [number for (number,) in _pairs(connection, library.c.number)] == sorted(shared.types)
        for index in read:
            self.compare_read(self.plain[index], self.number(index))

    def compare_types(self) -> None:
        """What other libraries would change."""
        shared = self.plain[0].shared
        for one in LIBRARIES:
            found = [astuple(each)[:4] for each in blueprint_store.type_differences(self.connection, one)]
            mine = [part_type for part_type in one if not part_type.source.startswith("msbot library, ")]
            assert found == [
                ("added", f"part type {part_type.number}", "", part_type.name)
                if there is None
                else (
                    "changed",
                    f"part type {part_type.number}",
                    f"{there.name}, as it was",
                    f"{part_type.name}, as its file says now",
                )
                for part_type in mine
                for there in [shared.types.get(part_type.number)]
                if there is None or replace(there, source="") != replace(part_type, source="")
            ]

    def compare_rows(self, numbers: Mapping[int, PlainRobot]) -> None:
        connection = self.connection
        rows = connection.execute(select(slots)).all()
        assert {
            (row.robot_id, row.name): (
                row.position,
                row.part_number,
                row.local_name,
                row.description,
                row.origin,
                row.in_blueprint,
                row.configuration_version,
            )
            for row in rows
        } == {
            (number, name): tuple(vars(one).values())
            for number, plain in numbers.items()
            for name, one in plain.slots.items()
        }
        names = {row.id: (row.robot_id, row.name) for row in rows}
        assert {
            (*names[row.slot_id], row.name, row.origin): (repr(row.value), row.changed_ns, row.who)
            for row in connection.execute(select(settings))
        } == {
            (number, *key): (repr(value), since, who)
            for number, plain in numbers.items()
            for key, (value, since, who) in plain.values.items()
        }
        found: dict[int, list[tuple[object, ...]]] = {number: [] for number in numbers}
        for row in connection.execute(select(bindings).order_by(bindings.c.id)):
            number, name = names[row.slot_id]
            assert number == row.robot_id
            found[number].append(
                (row.topic, name, row.port, row.type_name, row.publishes, row.reliable, row.origin, row.in_use)
            )
        assert found == {
            number: [tuple(vars(wire).values()) for wire in plain.wires] for number, plain in numbers.items()
        }
        named: dict[int | None, str | None] = {None: None, **{key: name for key, (_, name) in names.items()}}
        held = connection.execute(select(parts).where(parts.c.uid != "")).all()
        assert {
            (row.robot_id, row.identity): (named[row.slot_id], named[row.placed_slot_id], row.changed_ns)
            for row in held
        } == {
            (number, uid): (*place, plain.moved_ns[uid])
            for number, plain in numbers.items()
            for uid, place in plain.places.items()
        }
        for row in connection.execute(select(robots)):
            plain = numbers[row.id]
            assert {name: getattr(row, name) for name in plain.row} == _as_json(plain.row)

    def compare_read(self, plain: PlainRobot, number: int) -> None:
        connection = self.connection
        lines = [line for line in plain.shared.lines if line.robot == plain.name]
        assert [_told(edit) for edit in read_edits(connection, number, 4)] == [_line(line) for line in lines[:-5:-1]]
        found = read_configurations(connection, number)
        assert {
            name: (
                one.version,
                one.slot,
                one.settings,
                [(end.port, end.topic, end.type_name, end.publishes, end.reliable) for end in one.bindings],
            )
            for name, one in found.items()
        } == {
            name: (slot.version, name, _texts(plain.configuration(name)[1]), plain.configuration(name)[0])
            for name, slot in plain.slots.items()
        }
        for by_hand in (True, False):
            read = blueprint_reader.read(connection, number, by_hand=by_hand)
            wanted = plain.in_blueprint()
            wanted = wanted if by_hand else [name for name in wanted if plain.slots[name].origin == "blueprint"]
            origins = ("blueprint", "hand") if by_hand else ("blueprint",)
            assert [
                (one.name, one.part_number, one.local_name, one.description, one.settings) for one in read.slots
            ] == [
                (
                    name,
                    *[getattr(plain.slots[name], word) for word in ("part_number", "local_name", "description")],
                    {
                        key[1]: plain.values[key][0]
                        for origin in origins
                        for key in plain.values
                        if (key[0], key[2]) == (name, origin)
                    },
                )
                for name in wanted
            ]
            assert [replace(one, in_dds=InDds()) for one in read.bindings] == list(plain.bindings(by_hand=by_hand))
            shown = plain.row["in_dds"]
            assert isinstance(shown, dict)
            for one in read.bindings:
                told = shown.get(one.topic)
                assert one.in_dds == (InDds() if told is None else InDds(**told))
            assert read.ros == RosOptions(**shown.get("", {}))
            assert list(read.library) == shown.get(" library", [])
        assert blueprint_reader.read_notes(connection, number) == plain.notes()
        belong = {uid: plain.place(uid) for uid in plain.places if plain.place(uid) != (None, None)}
        assert part_places.read(connection, number) == belong


_T = TypeVar("_T")


def _tried(change: Callable[[], _T]) -> tuple[_T | None, str]:
    """What it returns, or why it is refused."""
    try:
        return change(), ""
    except ConfigError as error:
        return None, str(error)


def _pairs(connection: Connection, *columns: Any) -> list[tuple[object, ...]]:
    return [tuple(row) for row in connection.execute(select(*columns).order_by(*columns[:2]))]


def _as_json(value: Any) -> Any:
    match value:
        case dict():
            return {key: _as_json(one) for key, one in value.items()}
        case list() | tuple():
            return [_as_json(one) for one in value]
        case _:
            return value


def _texts(values: dict[str, Scalar]) -> tuple[tuple[str, str], ...]:
    return tuple(sorted((name, scalar_text(value)) for name, value in values.items()))


def _told(edit: EditRecord) -> tuple[object, ...]:
    return (
        edit.id,
        edit.at_ns,
        edit.who,
        edit.kind,
        edit.slot,
        edit.words,
        edit.undone,
        edit.slots,
        sorted(edit.placed, key=str),
        sorted(edit.placed_before, key=str),
        edit.can_be_undone,
    )


def _line(line: Line) -> tuple[object, ...]:
    """The same of a plain line."""
    changed: list[str] = []
    match line.before, line.after:
        case ("value", slot, *_), _:
            changed = [slot]
        case ("topics", before), ("topics", after):
            changed = [
                end.slot
                for old, new in zip(before, after, strict=True)
                for end in (*old[1], *new[1])
                if end not in old[1] or end not in new[1]
            ]
        case ("apply", before), ("apply", after):
            changed = different(before, after)
    now, then = (
        [(bytes.fromhex(uid), place[0]) for uid, place in content[1].items()]
        if content and content[0] == "place"
        else []
        for content in (line.after, line.before)
    )
    can_be = line.undone_by is None and line.kind in ("value", "place", "block", "bind", "apply")
    return (
        line.id,
        line.at_ns,
        line.who,
        line.kind,
        line.slot,
        line.words,
        line.undone_by is not None,
        tuple(sorted(set(changed))),
        sorted(now, key=str),
        sorted(then, key=str),
        can_be,
    )


@pytest.fixture
def connection(path: Path, empty_database: bytes) -> Iterator[Connection]:
    path.write_bytes(empty_database)
    engine = make_engine(parse_address(path), busy_timeout_s=1.0, read_only=False)
    with engine.connect() as connection:
        yield connection
    engine.dispose()


@pytest.mark.parametrize("seed", range(tries(3, 200)))
def test_whatever_people_change_every_row_is_as_the_plain_model_has_it(connection: Connection, seed: int) -> None:
    twins = Twins(connection, Random(seed))
    twins.compare()
    for _ in range(3):
        for is_read in (False, False, True) * 4:
            index = twins.step()
            twins.compare(read=[index] if is_read else [])
        twins.compare()
        twins.compare_types()

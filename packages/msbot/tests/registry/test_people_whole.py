"""What a class leaves in a database (users, keys, programs, ticks, groups), by chance, beside plain lists of it.

Names are alike in all tables, so that what hits the wrong person, lesson or robot is noticed; everything is compared
after every change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import replace
from functools import partial
from pathlib import Path
from random import Random
from typing import Any, TypeVar

import pytest
from sqlalchemy import Connection, select

from msbot.config import Library
from msbot.pnp import Group
from msbot.registry import class_groups, lesson_ticks, programs
from msbot.registry.blueprint import blueprint_store
from msbot.registry.class_groups import ClassGroups
from msbot.registry.database.engine import make_engine, parse_address
from msbot.registry.database.storage import Storage
from msbot.registry.database.tables import class_groups as group_rows
from msbot.registry.database.tables import edits, keys, program_texts
from msbot.registry.edits import edit_log, users
from msbot.registry.edits.editing import Edits
from msbot.registry.edits.users import PartKeys, Person, Users
from msbot.registry.lesson_ticks import LessonTicks, Tick
from msbot.registry.programs import Programs
from msbot.registry.records import KeyRecord, ProgramRecord, ProgramSource, ProgramVersion, RobotRecord, UserRecord
from msbot_xrce.errors import ConfigError, MsbotError, NotThere
from tests.effort import tries
from tests.registry.blueprint.test_blueprint_store import LIBRARY, ROBOT

PEOPLE = ("ann", "bob", "pupil", "ring")
NAMES = ("ring", "blink", "ann")
ROLES = ("viewer", "student", "teacher", "administrator")
_T = TypeVar("_T")


class Direct(Storage):
    """A storage of one connection, without threads."""

    def __init__(self, connection: Connection) -> None:
        self.connection, self.now = connection, 100
        self.epoch_ns = lambda: self.now

    def read(self, read: Callable[[Connection], _T]) -> _T:
        return read(self.connection)

    def change(self, change: Callable[[Connection], _T]) -> _T:
        with self.connection.begin_nested():
            return change(self.connection)

    def catch_up(self) -> None:
        pass


def kept_of(said: Sequence[tuple[int, str, str, str]]) -> list[tuple[int, str, str, str]]:
    """What is kept of these edits: of more than six, the oldest of the person with most of them gives way."""
    kept: list[tuple[int, str, str, str]] = []
    for one in said:
        kept.append(one)
        if len(kept) > 6:
            names = [who for _, who, _, _ in kept]
            most = max(map(names.count, names))
            del kept[next(index for index, who in enumerate(names) if names.count(who) == most)]
    return kept


class School:
    """The tables, and the plain lists."""

    def __init__(self, connection: Connection, random: Random) -> None:
        self.random, self.storage = random, Direct(connection)
        self.robots = [self.robot(serial) for serial in ("1", "2")]
        self.edits = Edits(self.storage)
        self.programs, self.ticks = Programs(self.storage), LessonTicks(self.storage)
        self.groups, self.users = ClassGroups(self.storage), Users(self.storage)
        self.keys = PartKeys(self.storage, self.edits)
        self.said: list[tuple[int, str, str, str]] = []
        self.plain: dict[str, Any] = {
            "users": {},
            "keys": {},
            "programs": {},
            "ticks": {},
            "groups": {0: [], 1: []},
            "made": 0,
        }

    def robot(self, serial: str) -> RobotRecord:
        blueprint = replace(ROBOT, robot=replace(ROBOT.robot, serial_number=serial))
        return blueprint_store.apply(self.storage.connection, blueprint, Library([*LIBRARY]), 1)

    def step(self) -> str:
        """One change by chance; returns whose programs it may concern."""
        random = self.random
        self.storage.now += random.choice((0, 1, 1))
        now, who, name = self.storage.now, random.choice(PEOPLE), random.choice(NAMES)
        plain = self.plain
        often = ("user", "key", "key", "keep", "keep", "tick", "tick")
        match random.choice((*often, *often, "remove", "no key", "delete", "share", "groups", "groups")):
            case "user":
                people = [self.person() for _ in range(random.choice((1, 2)))]
                self.both(
                    lambda: self.edits.make(None, who, partial(users.keep, people=people)).words,
                    lambda: [self.keep_user(one, who, now) for one in people][-1],
                )
            case "remove":
                self.both(
                    lambda: self.edits.make(None, who, partial(users.remove, name=name)).words,
                    lambda: self.remove_user(name, who, now),
                )
            case "key":
                uid, key = bytes([random.choice((0, 1, 2, 1, 2, 1, 2))]) * 8, bytes([random.randrange(256)]) * 16
                self.both(lambda: self.keys.store(uid, key, who).words, lambda: self.keep_key(uid, key, who, now))
            case "no key":
                uid = bytes([random.randrange(1, 3)]) * 8
                self.both(lambda: self.keys.remove(uid, who).words, lambda: self.remove_key(uid, who, now))
            case "keep":
                who = random.choice(PEOPLE[:2])
                source = ProgramSource(random.choice(("a", "bb", "ccc")), random.choice(("", "{}")))
                self.both(
                    lambda: self.programs.store(who, name, source), lambda: self.keep_program(who, name, source, now)
                )
            case "delete":
                self.both(lambda: self.programs.remove(who, name), lambda: self.program(who, name, is_removed=True))
            case "share":
                self.both(lambda: bool(self.programs.share(who, name)), lambda: self.share(who, name))
            case "tick":
                people_ = random.sample(PEOPLE, random.choice((0, 1, 2, 3)))
                lesson, check = random.choice(NAMES), random.choice(("", "1.1"))
                self.both(
                    lambda: self.ticks.note(people_, lesson, check, now), lambda: self.tick(people_, lesson, check)
                )
            case "groups":
                index = random.randrange(2)
                order, slots = random.sample(PEOPLE, 4), random.sample(NAMES, 3)
                cuts = (("blue", 0, 2, 0, 1), ("red", 2, 3, 1, 1), ("zoo", 3, 3, 1, 3))
                groups = [
                    Group(word, tuple(sorted(order[a:b])), tuple(sorted(slots[c:d])))
                    for word, a, b, c, d in cuts
                    if random.random() < 0.7
                ]
                self.both(
                    lambda: self.groups.replace(self.robots[index], reversed(groups)),
                    lambda: plain["groups"].update({index: groups}),
                )
        return who

    def person(self) -> Person:
        random = self.random
        name, role = random.choice((*PEOPLE, *PEOPLE, " ", "a\nb")), random.choice((*ROLES, *ROLES, "king"))
        return Person(name, role, random.choice(("", "salt")), random.choice(((), (("desk", "abc"),))))

    def both(self, really: Callable[[], object], plainly: Callable[[], object]) -> None:
        """Do it to both; what is refused is refused by both, in the same words, and has changed nothing."""
        kept, said = deepcopy(self.plain), list(self.said)
        found, why = _tried(really)
        expected, because = _tried(plainly)
        if because:
            self.plain, self.said = kept, said
        assert (found, why) == (expected, because)

    # The plain ones

    def keep_user(self, person: Person, who: str, now: int) -> str:
        known = self.plain["users"]
        name, role, password, tokens = person
        if role not in ROLES:
            raise ConfigError(f"there is no role {role!r}; there are {', '.join(ROLES)}")
        if name in (" ", "a\nb"):
            raise ConfigError(f"{name!r} is no name: 1 to 64 printable characters, without blanks around it")
        before: UserRecord | None = known.get(name)
        if before is not None and before.role == "administrator" and role != "administrator":
            self.spare_the_last(name)
        known[name] = UserRecord(name, role, password, tokens, before.created_ns if before else now, now)
        if before is None:
            words = f"user {name} added as {role}"
        elif before.role != role:
            words = f"user {name} is {role} now; was {before.role}"
        else:
            words = f"user {name} changed: {'tokens' if before.password_hash == password else 'password'}"
        self.said.append((now, who, "user", words))
        return words

    def spare_the_last(self, name: str) -> None:
        if not any(one.role == "administrator" and one.name != name for one in self.plain["users"].values()):
            raise ConfigError(f"{name} is the only administrator: make somebody else administrator first")

    def remove_user(self, name: str, who: str, now: int) -> str:
        plain = self.plain
        user = plain["users"].get(name)
        if user is None:
            raise ConfigError(f"there is no user {name!r}")
        if user.role == "administrator":
            self.spare_the_last(name)
        del plain["users"][name]
        plain["programs"] = {key: value for key, value in plain["programs"].items() if key[0] != name}
        plain["ticks"] = {key: value for key, value in plain["ticks"].items() if key[0] != name}
        plain["groups"] = {
            index: [Group(one.name, tuple(each for each in one.pupils if each != name), one.slots) for one in groups]
            for index, groups in plain["groups"].items()
        }
        self.said.append((now, who, "user", f"user {name} ({user.role}) removed"))
        return self.said[-1][-1]

    def keep_key(self, uid: bytes, key: bytes, who: str, now: int) -> str:
        if not any(uid):
            raise ConfigError("a part without a UID cannot have a key: there is nothing to know it by")
        words = f"part {uid.hex()} has {'another' if uid in self.plain['keys'] else 'a'} key"
        self.plain["keys"][uid] = key, now, who
        self.said.append((now, who, "key", words))
        return words

    def remove_key(self, uid: bytes, who: str, now: int) -> str:
        if uid not in self.plain["keys"]:
            raise ConfigError(f"part {uid.hex()} has no key")
        del self.plain["keys"][uid]
        self.said.append((now, who, "key", f"the key of part {uid.hex()} is removed"))
        return self.said[-1][-1]

    def program(self, owner: str, name: str, *, is_removed: bool = False) -> None:
        if (owner, name) not in self.plain["programs"]:
            raise NotThere(f"{owner} has no program {name!r}")
        if is_removed:
            del self.plain["programs"][owner, name]

    def keep_program(self, owner: str, name: str, source: ProgramSource, now: int) -> int:
        known = self.plain["programs"]
        if (owner, name) not in known:
            if sum(one == owner for one, _ in known) == 2:
                raise ConfigError(f"{owner} has 2 programs already: remove one first")
            self.plain["made"] += 1
            known[owner, name] = {"order": self.plain["made"], "at": now, "shared": False, "versions": []}
        program = known[owner, name]
        versions = program["versions"]
        if versions and versions[-1][1] == source:
            return int(versions[-1][0])
        versions.append((versions[-1][0] + 1 if versions else 1, source, now))
        del versions[:-2]
        program["at"] = now
        return int(versions[-1][0])

    def share(self, owner: str, name: str) -> bool:
        self.program(owner, name)
        self.plain["programs"][owner, name]["shared"] = True
        return True

    def tick(self, people: list[str], lesson: str, check: str) -> None:
        ticks = self.plain["ticks"]
        new = [(one, lesson, check) for one in people if (one, lesson, check) not in ticks]
        if new and len(ticks) + len(new) > 9:
            raise ConfigError("more than 9 ticks of lessons are not kept")
        ticks |= dict.fromkeys(new, self.storage.now)

    # What is there

    def compare(self, owners: Sequence[str] = PEOPLE) -> None:
        plain, connection = self.plain, self.storage.connection
        assert self.users.all() == sorted(plain["users"].values(), key=lambda one: one.name)
        assert [self.users.find(name) for name in PEOPLE] == [plain["users"].get(name) for name in PEOPLE]
        held = sorted(plain["keys"].items(), key=lambda item: (-item[1][1], item[0]))
        assert self.keys.all() == [KeyRecord(uid, at, who) for uid, (_, at, who) in held]
        assert [self.keys.find(bytes([digit]) * 8) for digit in range(3)] == [
            plain["keys"].get(bytes([digit]) * 8, (None,))[0] for digit in range(3)
        ]
        found = self.ticks.all()
        assert [(one.at_ns, one.person) for one in found] == sorted((one.at_ns, one.person) for one in found)
        assert {*found} == {Tick(person, lesson, check, at) for (person, lesson, check), at in plain["ticks"].items()}
        for index, robot in enumerate(self.robots):
            assert self.groups.of(robot) == [one for one in plain["groups"][index] if one.pupils or one.slots]
        told = [(edit.at_ns, edit.who, edit.kind, edit.words) for edit in self.edits.latest(None)]
        assert told == kept_of(self.said)[::-1]
        assert self.edits.latest(None, 2) == self.edits.latest(None)[:2]
        assert self.edits.latest(self.robots[0]) == []
        self.compare_programs(owners)
        rows = connection.execute(select(keys.c.uid)).all(), connection.execute(select(edits.c.id)).all()
        assert [len(one) for one in rows] == [len(plain["keys"]), min(len(self.said), 6)]

    def compare_programs(self, owners: Sequence[str]) -> None:
        known, api = self.plain["programs"], self.programs
        for owner in owners:
            mine = sorted(
                (key for key in known if key[0] == owner), key=lambda key: (-known[key]["at"], known[key]["order"])
            )
            found = api.of(owner)
            assert [(one.owner, one.name, bool(one.share), one.changed_ns) for one in found] == [
                (*key, known[key]["shared"], known[key]["at"]) for key in mine
            ]
            for one in found:
                self.compare_program(one, known[one.owner, one.name]["versions"])
            for name in {*NAMES} - {one.name for one in found}:
                for ask in (api.source, api.versions):
                    assert _tried(partial(ask, owner, name)) == (None, f"{owner} has no program {name!r}")
        rows = self.storage.connection.execute(select(program_texts.c.number)).all()
        assert len(rows) == sum(len(one["versions"]) for one in known.values())
        for word in ("", "guessed"):
            assert _tried(partial(api.shared, word)) == (None, "nobody shares a program by that link (any more)")

    def compare_program(self, one: ProgramRecord, versions: list[tuple[int, ProgramSource, int]]) -> None:
        api, owner, name = self.programs, one.owner, one.name
        assert api.versions(owner, name) == [
            ProgramVersion(number, at, len(source.text)) for number, source, at in reversed(versions)
        ]
        assert api.source(owner, name) == versions[-1][1]
        assert [api.source(owner, name, number) for number, *_ in versions] == [source for _, source, _ in versions]
        for number in (versions[0][0] - 1, versions[-1][0] + 1):
            gone = f"version {number} of {name} is not kept any more"
            assert _tried(partial(api.source, owner, name, number)) == (None, gone)
        if one.share:
            assert len(one.share) >= 16
            assert api.share(owner, name) == one.share
            assert api.shared(one.share) == (owner, name, versions[-1][1])


def _tried(change: Callable[[], _T]) -> tuple[_T | None, str]:
    """What it returns, or why it is refused."""
    try:
        return change(), ""
    except MsbotError as error:
        return None, str(error)


@pytest.fixture
def connection(path: Path, empty_database: bytes) -> Iterator[Connection]:
    path.write_bytes(empty_database)
    engine = make_engine(parse_address(path), busy_timeout_s=1.0, read_only=False)
    with engine.connect() as connection:
        yield connection
    engine.dispose()


@pytest.mark.parametrize("seed", range(tries(2, 50)))
def test_what_a_class_leaves_is_what_the_plain_lists_have(
    connection: Connection, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    monkeypatch.setattr(programs, "MOST_PROGRAMS", 2)
    monkeypatch.setattr(programs, "MOST_VERSIONS", 2)
    monkeypatch.setattr(lesson_ticks, "MOST_TICKS", 9)
    monkeypatch.setattr(edit_log, "EDITS_KEPT", 6)
    school = School(connection, Random(seed))
    for _ in range(tries(48, 500)):
        school.compare([school.step()])
    school.compare()
    school.plain["groups"][0] = []
    school.groups.replace(school.robots[0], [])
    school.compare()
    assert {row.kind for row in connection.execute(select(group_rows))} <= {class_groups.PUPIL, class_groups.SLOT}

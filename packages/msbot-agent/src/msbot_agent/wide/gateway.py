"""The gateway of a site: writes what it reads on one side on the other, as its rules say."""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import Iterator, Sequence
from enum import StrEnum
from functools import partial
from pathlib import Path

from msbot_agent.space import (
    ZENOH,
    Guid,
    Qos,
    Reader,
    Sample,
    Space,
    SpaceAddress,
    Topic,
    Writer,
    is_service_topic,
    parse_space,
    robot_partition,
)
from msbot_agent.toml.document import read_document
from msbot_agent.toml.problems import Problems
from msbot_agent.toml.table import Table
from msbot_xrce.errors import ConfigError, LocalProtocolError
from msbot_xrce.lazy import dataclass

# Reads `gateway.toml`: what crosses between the data space of a site and the others.


MOST_CROSSINGS = 1000
DEEPEST = 10_000
LONGEST_S = 3600.0


class BridgeDirection(StrEnum):
    """Which way a topic crosses, seen from the site."""

    OUT = "out"
    IN = "in"
    BOTH = "both"


@dataclass(frozen=True, slots=True)
class BridgedTopic:
    """A topic that crosses."""

    topic: Topic
    direction: BridgeDirection
    robot: str
    """Whose topic it is; empty: nobody's."""
    qos: Qos

    def qos_in(self, address: SpaceAddress) -> Qos:
        """Its quality of service in one of the two spaces, where robots have partitions of their own names."""
        partition = robot_partition(address, self.robot) if self.robot else ""
        return Qos(
            reliable=self.qos.reliable,
            transient_local=self.qos.transient_local,
            depth=self.qos.depth,
            separation_s=self.qos.separation_s,
            partitions=(partition,),
        )


@dataclass(frozen=True, slots=True)
class GatewayRules:
    """A whole file."""

    inside: SpaceAddress
    outside: SpaceAddress
    crossings: tuple[BridgedTopic, ...]


def read_gateway_file(path: Path) -> GatewayRules:
    """Read the file; names of certificates in it are seen from its folder.

    Raises:
        ConfigError: it cannot be read, or is wrong; the text names every problem with line and remedy.
    """
    problems = Problems()
    document = read_document(path, problems, if_missing="write it as `msbot help zenoh` shows")
    problems.raise_if_any()
    assert document is not None
    root = Table(document, problems, document.values)
    inside = _space(root, "inside", "dds", path.parent)
    outside = _space(root, "outside", "zenoh:tcp/127.0.0.1:7447", path.parent)
    if outside.kind != ZENOH and "outside" in root:
        root.report('the others are reached by Zenoh: write for example outside = "zenoh:tcp/HOST:7447"', "outside")
    if inside == outside:
        root.report("inside and outside are the same: nothing would cross", "outside")
    tables = root.tables("cross")
    if not tables:
        root.report("nothing crosses: add a table that begins with [[cross]]", "cross")
    if len(tables) > MOST_CROSSINGS:
        root.report(f"there are {len(tables)} of them; {MOST_CROSSINGS} are the most", "cross")
    crossings = [_crossing(table) for table in tables[:MOST_CROSSINGS]]
    _check_twice(tables, crossings)
    root.finish()
    problems.raise_if_any()
    return GatewayRules(inside, outside, tuple(crossings))


def _space(root: Table, key: str, example: str, folder: Path) -> SpaceAddress:
    text = root.name(key, example)
    if not text:
        return SpaceAddress(key)  # never used: the key is missing or wrong, and has been told
    try:
        return parse_space(text, folder=folder)
    except ConfigError as error:
        root.report(str(error), key)
        return SpaceAddress(key)


def _crossing(table: Table) -> BridgedTopic:
    topic = table.name("topic", "light", forbidden="*?[]#$")
    type_name = table.name("type", "Light", forbidden="*?[]#$")
    if is_service_topic(topic):
        table.report("requests and replies of services do not cross; only topics do", "topic")
    keep = table.whole("keep", default=0, least=0, most=DEEPEST)
    depth = table.whole("depth", default=max(16, keep), least=1, most=DEEPEST)
    if keep > depth:
        table.report(f"is {keep}, and depth is {depth}: it cannot be more than that", "keep")
    crossing = BridgedTopic(
        Topic(topic, type_name, table.whole("domain", default=0, least=0, most=232)),
        BridgeDirection(table.choice("direction", [*BridgeDirection])),
        table.name("robot", "ROVER", default="", forbidden="*?[]/"),
        Qos(
            reliable=table.flag("reliable", default=True),
            transient_local=keep > 0,
            depth=keep or depth,
            separation_s=table.number("every_s", default=0.0, least=0.0, most=LONGEST_S, unit="s"),
        ),
    )
    table.finish()
    return crossing


def _check_twice(tables: list[Table], crossings: list[BridgedTopic]) -> None:
    seen: dict[tuple[Topic, str], int] = {}
    for number, (table, crossing) in enumerate(zip(tables, crossings, strict=False), start=1):
        before = seen.setdefault((crossing.topic, crossing.robot), number)
        if before != number and crossing.topic.name:
            table.report(f'"{crossing.topic.name}" crosses already, by number {before} of the list', "topic")


LOOK_S = 2.0
"""How often it looks for endpoints that cannot match."""

logger = logging.getLogger(__name__)


class _TopicCrossing:
    """One topic in one direction."""

    def __init__(self, crossing: BridgedTopic, words: str, reader_qos: Qos, writer_qos: Qos) -> None:
        self.crossing = crossing
        self.words = words
        """`out` or `in`."""
        self.reader_qos = reader_qos
        self.writer_qos = writer_qos
        self.crossed = 0
        self.reader: Reader | None = None
        self.writer: Writer | None = None


class Gateway:
    """Carries topics between two spaces, each of which may come and go as it likes."""

    def __init__(
        self,
        inside: Space,
        outside: Space,
        addresses: tuple[SpaceAddress, SpaceAddress],
        crossings: Sequence[BridgedTopic],
    ) -> None:
        """Begin to carry.

        Args:
            inside: the site's own space.
            outside: the one that the sites share.
            addresses: of both.
            crossings: what crosses.
        """
        self._ways: list[_TopicCrossing] = []
        self._told: set[str] = set()
        self._own: set[Guid] = set()
        """Our writers: what comes from them has just crossed."""
        sides = ((inside, addresses[0]), (outside, addresses[1]))
        for crossing in crossings:
            for direction, (here, there) in ((BridgeDirection.OUT, sides), (BridgeDirection.IN, sides[::-1])):
                if crossing.direction in (direction, BridgeDirection.BOTH):
                    self._open(
                        _TopicCrossing(crossing, direction, crossing.qos_in(here[1]), crossing.qos_in(there[1])),
                        here[0],
                        there[0],
                    )

    async def run(self) -> None:
        """Say once of each topic what keeps it from crossing; carrying itself needs no task. Never ends."""
        while True:
            for sentence in self.troubles():
                if sentence not in self._told:
                    self._told.add(sentence)
                    logger.warning("%s", sentence)
            await asyncio.sleep(LOOK_S)

    def crossed(self) -> Iterator[tuple[str, str, int]]:
        """Topic, direction and number of samples so far, for each way."""
        for way in self._ways:
            yield way.crossing.topic.name, way.words, way.crossed

    def troubles(self) -> list[str]:
        """What keeps topics from crossing now, without figures that change all the time."""
        found: dict[str, None] = {}
        for way in self._ways:
            for end in (way.reader, way.writer):
                if end is not None:
                    for sentence in end.troubles():
                        if " lost" not in sentence:
                            found[sentence] = None
        return list(found)

    def close(self) -> None:
        """Carry nothing more."""
        for way in self._ways:
            for end in (way.reader, way.writer):
                if end is not None:
                    end.close()

    def _open(self, way: _TopicCrossing, here: Space, there: Space) -> None:
        topic = way.crossing.topic
        way.writer = there.writer(topic, way.writer_qos, os.urandom(16))
        self._own.add(way.writer.guid)
        self._ways.append(way)
        way.reader = here.reader(topic, way.reader_qos, partial(self._carry, way))

    def _carry(self, way: _TopicCrossing, sample: Sample) -> bool:
        if way.writer is None or sample.writer in self._own:
            return True
        try:
            way.writer.write(sample.payload)
        except LocalProtocolError as error:
            logger.warning("%s", error)
        else:
            way.crossed += 1
        return True

"""Reads `gateway.toml`: what crosses between the data space of a site and the others."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path

from msbot_agent.space import ZENOH, Qos, SpaceAddress, Topic, is_service_topic, parse_space, robot_partition
from msbot_agent.toml.document import read_document
from msbot_agent.toml.problems import Problems
from msbot_agent.toml.table import Table
from msbot_xrce.common.lazy_dataclass import dataclass
from msbot_xrce.errors import ConfigError

MOST_CROSSINGS = 1000
DEEPEST = 10_000
LONGEST_S = 3600.0


class CrossingWay(StrEnum):
    """Which way a topic crosses, seen from the site."""

    OUT = "out"
    IN = "in"
    BOTH = "both"


@dataclass(frozen=True, slots=True)
class CrossingTopic:
    """A topic that crosses."""

    topic: Topic
    direction: CrossingWay
    robot: str
    """Whose topic it is; empty: nobody's."""
    qos: Qos

    def qos_in(self, address: SpaceAddress) -> Qos:
        """Its quality of service in one of the two spaces, where robots have partitions of their own names."""
        partition = robot_partition(address, self.robot) if self.robot else ""
        return Qos(
            reliable=self.qos.reliable, transient_local=self.qos.transient_local, depth=self.qos.depth,
            separation_s=self.qos.separation_s, partitions=(partition,),
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class GatewayRules:
    """A whole file."""

    inside: SpaceAddress
    outside: SpaceAddress
    crossings: tuple[CrossingTopic, ...]


def read_gateway_file(path: Path) -> GatewayRules:
    """Read the file; names of certificates in it are seen from its folder.

    Raises:
        ConfigError: it cannot be read, or is wrong; the text names every problem with line and remedy.
    """
    problems = Problems()
    document = read_document(path, problems, if_missing="write it as docs/howto/zenoh.md shows")
    problems.raise_if_any()
    assert document is not None
    root = Table(document, problems, document.values)
    inside = _space(root, "inside", "dds", path.parent)
    outside = _space(root, "outside", "zenoh:tcp/127.0.0.1:7447", path.parent)
    if outside.kind != ZENOH and "outside" in root:
        root.problem('the others are reached by Zenoh: write for example outside = "zenoh:tcp/HOST:7447"', "outside")
    if inside == outside:
        root.problem("inside and outside are the same: nothing would cross", "outside")
    tables = root.tables("cross")
    if not tables:
        root.problem("nothing crosses: add a table that begins with [[cross]]", "cross")
    if len(tables) > MOST_CROSSINGS:
        root.problem(f"there are {len(tables)} of them; {MOST_CROSSINGS} are the most", "cross")
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
        root.problem(str(error), key)
        return SpaceAddress(key)


def _crossing(table: Table) -> CrossingTopic:
    topic = table.name("topic", "light", forbidden="*?[]#$")
    type_name = table.name("type", "Light", forbidden="*?[]#$")
    if is_service_topic(topic):
        table.problem("requests and replies of services do not cross; only topics do", "topic")
    keep = table.whole("keep", default=0, least=0, most=DEEPEST)
    depth = table.whole("depth", default=max(16, keep), least=1, most=DEEPEST)
    if keep > depth:
        table.problem(f"is {keep}, and depth is {depth}: it cannot be more than that", "keep")
    crossing = CrossingTopic(
        Topic(topic, type_name, table.whole("domain", default=0, least=0, most=232)),
        CrossingWay(table.choice("direction", [*CrossingWay])),
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


def _check_twice(tables: list[Table], crossings: list[CrossingTopic]) -> None:
    seen: dict[tuple[Topic, str], int] = {}
    for number, (table, crossing) in enumerate(zip(tables, crossings, strict=False), start=1):
        before = seen.setdefault((crossing.topic, crossing.robot), number)
        if before != number and crossing.topic.name:
            table.problem(f'"{crossing.topic.name}" crosses already, by number {before} of the list', "topic")

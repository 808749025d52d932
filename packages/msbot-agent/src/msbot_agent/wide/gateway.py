"""The gateway of a site: writes what it reads on one side on the other, as its rules say."""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import Iterator, Sequence
from functools import partial

from msbot_agent.space import Guid, Qos, Reader, Sample, Space, SpaceAddress, Writer
from msbot_agent.wide.gateway_file import CrossingTopic, CrossingWay
from msbot_xrce.errors import LocalProtocolError

LOOK_S = 2.0
"""How often it looks for endpoints that cannot match."""

logger = logging.getLogger(__name__)


class _Way:
    """One topic in one direction."""

    def __init__(self, crossing: CrossingTopic, words: str, reader_qos: Qos, writer_qos: Qos) -> None:
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
        crossings: Sequence[CrossingTopic],
    ) -> None:
        """Begin to carry.

        Args:
            inside: the site's own space.
            outside: the one that the sites share.
            addresses: of both.
            crossings: what crosses.
        """
        self._ways: list[_Way] = []
        self._told: set[str] = set()
        self._own: set[Guid] = set()
        """Our writers: what comes from them has just crossed."""
        sides = ((inside, addresses[0]), (outside, addresses[1]))
        for crossing in crossings:
            for direction, (here, there) in ((CrossingWay.OUT, sides), (CrossingWay.IN, sides[::-1])):
                if crossing.direction in (direction, CrossingWay.BOTH):
                    self._open(_Way(crossing, direction, crossing.qos_in(here[1]), crossing.qos_in(there[1])),
                               here[0], there[0])  # fmt: skip

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

    def _open(self, way: _Way, here: Space, there: Space) -> None:
        topic = way.crossing.topic
        way.writer = there.writer(topic, way.writer_qos, os.urandom(16))
        self._own.add(way.writer.guid)
        self._ways.append(way)
        way.reader = here.reader(topic, way.reader_qos, partial(self._carry, way))

    def _carry(self, way: _Way, sample: Sample) -> bool:
        if way.writer is None or sample.writer in self._own:
            return True
        try:
            way.writer.write(sample.payload)
        except LocalProtocolError as error:
            logger.warning("%s", error)
        else:
            way.crossed += 1
        return True

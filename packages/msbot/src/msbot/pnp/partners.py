"""Who hears whom: which parts to tell when nobody publishes any more what they read, or somebody does again. Pure.

A topic has a partner as long as one registered part publishes it. Everything within one turn of the inventory counts as
a single change: when a spare takes over a slot in the moment it becomes free, nobody is left without a partner.
"""

from __future__ import annotations

from collections import deque

from msbot.pnp.inventory_record import InventoryRecord

PartnerChange = tuple[int, str, bool]
"""Client key of the part that reads, topic, and whether somebody publishes it now."""


class Partners:
    """An index of the registered parts by the topics that they publish and read."""

    def __init__(self) -> None:
        self._touched: deque[InventoryRecord] = deque()
        self._bound: dict[InventoryRecord, tuple[frozenset[str], frozenset[str]]] = {}
        """What each part publishes and reads, as in the two indexes."""
        self._publishers: dict[str, set[InventoryRecord]] = {}
        self._readers: dict[str, dict[InventoryRecord, None]] = {}

    def touch(self, record: InventoryRecord) -> None:
        """Note that a part was registered, delisted, or configured again."""
        self._touched.append(record)

    def has_publisher(self, topic: str) -> bool:
        """Whether a registered part publishes a topic, as of the last `settle`."""
        return bool(self._publishers.get(topic))

    def settle(self) -> list[PartnerChange]:
        """Bring the indexes up to date; returns what changed for parts that were there before and still are."""
        there: dict[str, bool] = {}
        """Topics whose publishers changed -> whether they had one before."""
        newcomers: set[InventoryRecord] = set()
        while self._touched:
            record = self._touched.popleft()
            publishes, reads = _topics_of(record)
            published, read = self._bound.pop(record, (frozenset(), frozenset()))
            for topic in publishes | published:
                there.setdefault(topic, bool(self._publishers.get(topic)))
            for topic in published:
                self._publishers[topic].discard(record)
            for topic in publishes:
                self._publishers.setdefault(topic, set()).add(record)
            for topic in read:
                self._readers[topic].pop(record, None)
            for topic in reads:
                self._readers.setdefault(topic, {})[record] = None
            if not published and not read:
                newcomers.add(record)
            if publishes or reads:
                self._bound[record] = (publishes, reads)
        return [
            (reader.client_key, topic, now_there)
            for topic, was_there in there.items()
            if (now_there := bool(self._publishers.get(topic))) is not was_there
            for reader in self._readers.get(topic, ())
            if reader not in newcomers
        ]


def _topics_of(record: InventoryRecord) -> tuple[frozenset[str], frozenset[str]]:
    if not record.is_registered or record.configuration is None:
        return frozenset(), frozenset()
    bindings = record.configuration.bindings
    return (
        frozenset(binding.topic for binding in bindings if binding.publishes and not record.is_held),
        frozenset(binding.topic for binding in bindings if not binding.publishes),
    )

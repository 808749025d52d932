"""The endpoints of services in other programs, as their participants tell of them."""

from __future__ import annotations

from collections.abc import Iterator

from msbot_agent.space.contract import Guid
from msbot_agent.space.rtps.descriptions import EndpointDescription
from msbot_agent.space.rtps.wire import Prefix

MAX_ENDPOINTS = 8192
"""Endpoints that are remembered."""


class Others:
    """What is known of them, by GUID and by topic."""

    def __init__(self) -> None:
        self._known: dict[Guid, EndpointDescription] = {}
        self._by_topic: dict[str, dict[Guid, EndpointDescription]] = {}

    def __len__(self) -> int:
        return len(self._known)

    def get(self, guid: Guid) -> EndpointDescription | None:
        """What was told of it."""
        return self._known.get(guid)

    def on_topic(self, topic: str) -> Iterator[EndpointDescription]:
        """All on a topic."""
        return iter(self._by_topic.get(topic, {}).values())

    def of(self, prefix: Prefix) -> list[Guid]:
        """All of a participant."""
        return [guid for guid in self._known if guid[:12] == prefix]

    def add(self, told: EndpointDescription) -> bool:
        """Remember one; False when there is no room."""
        if len(self._known) >= MAX_ENDPOINTS:
            return False
        self._known[told.guid] = told
        self._by_topic.setdefault(told.topic, {})[told.guid] = told
        return True

    def remove(self, guid: Guid) -> EndpointDescription | None:
        """Forget one; what was known of it."""
        told = self._known.pop(guid, None)
        if told is not None:
            namesakes = self._by_topic[told.topic]
            del namesakes[guid]
            if not namesakes:
                del self._by_topic[told.topic]
        return told

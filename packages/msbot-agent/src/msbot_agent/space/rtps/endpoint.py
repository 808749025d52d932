"""A writer or reader of ours, and what is told of it."""

from __future__ import annotations

from msbot_agent.space.contract import Guid
from msbot_agent.space.rtps.descriptions import EndpointDescription
from msbot_agent.space.rtps.reader import ReliableReader
from msbot_agent.space.rtps.writer import ReliableWriter
from msbot_xrce.common.lazy_dataclass import dataclass


@dataclass(slots=True, eq=False)
class RtpsEndpoint:
    """A writer or reader of ours."""

    description: EndpointDescription
    writer: ReliableWriter | None = None
    reader: ReliableReader | None = None
    replies: str = ""
    """Of a writer of requests: the topic of their replies."""
    number: int = 0
    """In which sample of discovery it is told."""

    @property
    def guid(self) -> Guid:
        """By which others know it."""
        return self.description.guid

    @property
    def state(self) -> ReliableWriter | ReliableReader:
        """Its state machine."""
        found = self.writer or self.reader
        assert found is not None
        return found

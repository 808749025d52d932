"""What the API says of topics and of the robot's log, as `msbot topic` and `msbot log --follow` show them."""

from __future__ import annotations

from pydantic import Field, JsonValue

from msbot_web.models.robot_models import Model


class TopicEnd(Model):
    """A port at a topic."""

    slot: str
    port: str
    part: str = Field(description="Part number of the part in the slot; empty: there is none.")


class TopicInfo(Model):
    """A topic: its type, who publishes and who subscribes, and what it has carried."""

    topic: str
    type: str = Field(description="Empty: a free topic, of any type.")
    free: bool
    service: bool = Field(description="It carries requests and replies; publishers serve, subscribers call.")
    reliable: bool
    fields: list[tuple[str, str]] = Field(description="Name and kind of each.")
    types: dict[str, list[tuple[str, str]]] = Field(
        description="The fields of its type, of types inside, of request and reply, by type; of an enum its values."
    )
    units: dict[str, str]
    type_units: dict[str, dict[str, str]] = Field(description="The same for each of its types, by type.")
    publishers: list[TopicEnd]
    subscribers: list[TopicEnd]
    published: int = Field(description="Messages since the master began.")
    delivered: int


class TopicMessage(Model):
    """One message."""

    at: float = Field(description="Seconds since 1970.")
    octets: int
    slot: str = Field(description="Who said it; empty: no part.")
    fields: JsonValue


class TopicMessages(Model):
    """Messages of a topic."""

    type: str
    next: int = Field(description="The number to ask for next time, as `after`.")
    missed: int = Field(description="How many were gone before they were asked for.")
    samples: list[TopicMessage]


class LogLineModel(Model):
    """A line of the robot's log."""

    at: float = Field(description="Seconds since 1970.")
    kind: str = Field(description="part, program or person.")
    who: str
    slot: str
    level: str = Field(description="info, warning or error.")
    words: str


class LogLines(Model):
    """Lines of the robot's log."""

    next: int = Field(description="The number to ask for next time, as `after`.")
    missed: int = Field(description="How many were gone before they were asked for.")
    lines: list[LogLineModel]

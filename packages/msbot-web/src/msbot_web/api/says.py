"""What a part says of itself, and the wires that would fit it, as pages and API show them."""

from __future__ import annotations

from pydantic import Field

from msbot_web.api.model import Model
from msbot_web.api.said import Said


class SaysPort(Model):
    """A port that a part says it has."""

    name: str
    direction: str
    """`publish` or `subscribe`."""
    type: str
    fields: list[str]
    """The fields of its messages with their units."""
    safe: str
    """Its safe value in words; empty: none."""


class SaysSetting(Model):
    """A setting that a part says it has."""

    name: str
    default: str
    least: float | None
    most: float | None
    unit: str


class Says(Model):
    """What a part says of itself: data of a stranger, checked, and not in force."""

    name: str = ""
    """What it is, in a few words."""
    description: str = ""
    ports: list[SaysPort] = Field(default_factory=list)
    settings: list[SaysSetting] = Field(default_factory=list)
    checked: bool
    """Whether it can be adopted."""
    fault: Said = ""
    """Why it is refused."""


class Offer(Model):
    """A wire that fits by its type: the arguments of `POST /topics/{topic}/bind`."""

    topic: str
    type: str
    source: str = Field(alias="from")
    to: list[str]

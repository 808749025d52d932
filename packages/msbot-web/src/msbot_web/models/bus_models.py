"""What API and pages say of a CAN bus and of its frames."""

from __future__ import annotations

from msbot_web.models.robot_models import Model
from msbot_web.models.sentence_field import SentenceField


class BusFigures(Model):
    """The CAN bus, or zeros when there is none to watch."""

    watched: bool
    name: str
    bitrate: int
    data_bitrate: int = 0
    """Of the fast part of CAN FD frames; 0: it is not known, or there is none."""
    frames: int
    """Frames since the server began to listen; exact."""
    load_percent: float
    frames_per_second: float
    errors: int


class FrameLine(Model):
    """One frame of the bus."""

    number: int
    age_s: float
    sender: str
    text: str
    node: int
    plain: list[SentenceField]
    about: list[SentenceField]
    """To a person: the values in it (`knob says level 49.9 %`), or what it is for (`knob says that it is alive`)."""
    words: list[str]  # to an engineer, from the frame to the sample
    notation: str = ""
    """The frame as can-utils and `msbot plot --frame` take it (`101#C010`)."""

"""How models keep what the robot says: as the sentence it is, so that a page can say it in its language."""

from __future__ import annotations

from typing import Annotated

from pydantic import PlainValidator, WithJsonSchema


def _as_sentence(value: object) -> str:
    """A text as it came: a sentence stays one, so that a page can say it in its language."""
    if not isinstance(value, str):
        raise ValueError("must be a text")
    return value


SentenceField = Annotated[str, PlainValidator(_as_sentence), WithJsonSchema({"type": "string"})]
"""What the robot says: for programs a text in English, for pages a sentence of any language."""

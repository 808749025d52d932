"""What `msbot demo --script` does to parts, and when."""

from __future__ import annotations

import re
from dataclasses import dataclass

import click


@dataclass(frozen=True, slots=True)
class ScriptStep:
    """One thing to do at a given time."""

    at_s: float
    verb: str
    """`plug`, `unplug` or `undo`."""
    part: str
    """Empty for `undo`."""


class ScriptType(click.ParamType[list[ScriptStep]]):
    """`3:unplug AA;12:plug AA`."""

    name = "script"

    def convert(
        self, value: str | list[ScriptStep], param: click.Parameter | None, ctx: click.Context | None
    ) -> list[ScriptStep]:
        """The steps, in order of time."""
        if isinstance(value, list):
            return value
        steps = []
        for text in filter(None, (piece.strip() for piece in value.split(";"))):
            match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*:\s*(?:(plug|unplug)\s+(\S+)|(undo))", text)
            if match is None:
                self.fail(
                    f"{text!r} is not a step; write SECONDS:plug PART, SECONDS:unplug PART or SECONDS:undo, "
                    "for example 3:unplug AA",
                    param,
                    ctx,
                )
            steps.append(ScriptStep(float(match[1]), match[2] or match[4], match[3] or ""))
        return sorted(steps, key=lambda step: step.at_s)

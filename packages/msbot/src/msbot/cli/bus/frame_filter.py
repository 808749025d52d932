"""Which frames of a bus somebody wants to see: `--filter 100:780`, `--filter 7FF~7FF`, `--filter node=3`."""

from __future__ import annotations

import re

import click

from msbot_agent.link.can.protocol import NODES, CanIds, Frame
from msbot_xrce.common.lazy_dataclass import dataclass

_IDS = CanIds()
_WORDS = re.compile(r"([0-9A-Fa-f]{1,8})(?:([:~])([0-9A-Fa-f]{1,8}))?")


@dataclass(frozen=True, slots=True)
class FrameFilter:
    """One filter; a frame is shown when it matches at least one."""

    can_id: int
    mask: int
    extended: bool
    inverse: bool = False

    def matches(self, frame: Frame) -> bool:
        """Whether the frame is wanted."""
        hit = frame.extended == self.extended and not (frame.can_id ^ self.can_id) & self.mask
        return hit is not self.inverse


class FilterType(click.ParamType[tuple[FrameFilter, ...]]):
    """`ID`, `ID:MASK`, `ID~MASK` (all but those), each hexadecimal, or `node=N`."""

    name = "FILTER"

    def convert(
        self,
        value: str | tuple[FrameFilter, ...],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> tuple[FrameFilter, ...]:
        """The filters that one option stands for."""
        if isinstance(value, tuple):
            return value
        if value.startswith("node="):
            digits = value.removeprefix("node=")
            if not (digits.isascii() and digits.isdigit() and 1 <= int(digits) <= NODES):
                self.fail(f"{value!r}: the nodes of a bus are 1 to {NODES}", param, ctx)
            return tuple(FrameFilter(base + int(digits), 0x7FF, extended=False) for base in (_IDS.up, _IDS.down))
        match = _WORDS.fullmatch(value)
        if match is None:
            self.fail(
                f"{value!r}: write ID, ID:MASK, ID~MASK (all but those) or node=N, for example 100:780", param, ctx
            )
        extended = len(match[1]) > 3
        mask = int(match[3], 16) if match[3] else 0x1FFFFFFF if extended else 0x7FF
        return (FrameFilter(int(match[1], 16), mask, extended, match[2] == "~"),)


def wanted(frame: Frame, filters: tuple[FrameFilter, ...]) -> bool:
    """Whether a frame matches a filter, or there are no filters."""
    return not filters or any(wish.matches(frame) for wish in filters)

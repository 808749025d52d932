"""Options that commands of every kind share."""

from __future__ import annotations

import math
import re

import click

from msbot_agent.cli.group import printable_name
from msbot_agent.space import SpaceAddress, parse_space
from msbot_xrce.errors import ConfigError

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of words.")


class SpaceType(click.ParamType[SpaceAddress]):
    """`memory`, `dds`, `dds:5?interface=eth0`, `zenoh:tcp/host:7447`."""

    name = "space"

    def convert(
        self, value: str | SpaceAddress, param: click.Parameter | None, ctx: click.Context | None
    ) -> SpaceAddress:
        """The address of a data space."""
        if isinstance(value, SpaceAddress):
            return value
        try:
            return parse_space(value)
        except ConfigError as error:
            self.fail(str(error), param, ctx)


space_option = click.option(
    "--space",
    type=SpaceType(),
    metavar="memory|dds[:DOMAIN]|zenoh[:ENDPOINT]",
    default="memory",
    show_default=True,
    help="Where topics are: in this process; in DDS, where ROS 2 and others see them (extra msbot-agent[dds]); or at a "
    "Zenoh router, for sites far apart (extra msbot-agent[zenoh]).",
)


# Numbers on the command line: what is none, or too small or great, is refused by saying what would be right.


_WHOLE = re.compile(r"\s*[+-]?[0-9]+\s*", re.ASCII)


class WholeRange(click.IntRange):
    """A whole number, in a range or any. Its digits are 0 to 9: Python reads `8_8` and the digits of other scripts."""

    name = "number"

    def _describe_range(self) -> str:
        """For `--help`."""
        return described(self.min, self.max).removeprefix("of ")

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """The number, or click's error."""
        if isinstance(value, str) and not (_WHOLE.fullmatch(value) and len(value) <= 100):
            self.fail(refusal(value, "a whole number", self.min, self.max), param, ctx)
        number = int(value)  # type: ignore[call-overload]
        if (self.min is not None and number < self.min) or (self.max is not None and number > self.max):
            self.fail(refusal(value, "a whole number", self.min, self.max), param, ctx)
        return int(number)


class FiniteRange(click.FloatRange):
    """A number, in a range or any; `nan`, which is in none and yet below and above nothing, and `inf` are refused."""

    name = "number"

    def _describe_range(self) -> str:
        """For `--help`."""
        return described(self.min, self.max).removeprefix("of ")

    def convert(self, value: object, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """The number, or click's error."""
        try:
            number = float(value)  # type: ignore[arg-type]
        except ValueError:
            number = math.nan
        low, high = -math.inf if self.min is None else self.min, math.inf if self.max is None else self.max
        if not (math.isfinite(number) and low <= number <= high):
            self.fail(refusal(value, "a number", self.min, self.max), param, ctx)
        return number


def refusal(value: object, kind: str, low: float | None, high: float | None) -> str:
    """What is said of a value that is not `kind` from `low` to `high`."""
    return f"'{printable_name(value)}' is not {kind} {described(low, high)}".rstrip()


def described(low: float | None, high: float | None) -> str:
    """The range in words; nothing where every number is right."""
    if low is not None and high is not None:
        return f"from {low} to {high}"
    if low is not None:
        return f"of {low} or more"
    return "" if high is None else f"of {high} or less"

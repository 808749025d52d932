"""Options that commands of every kind share."""

from __future__ import annotations

import click

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

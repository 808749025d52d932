"""`--home-assistant` of a master: its robot appears in Home Assistant."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from msbot_agent.cli.command_services import Beside, CommandService
from msbot_xrce.errors import ConfigError

if TYPE_CHECKING:
    from msbot.cli.run.master_services import MasterContext
    from msbot_bridges.mqtt.broker import BrokerAddress


class InHomeAssistant(CommandService["BrokerAddress", "MasterContext"]):
    """Shows the robot at an MQTT broker."""

    options = (
        click.option(
            "--home-assistant",
            metavar="mqtt://HOST",
            help="Show the robot in Home Assistant, which is at this MQTT broker.",
        ),
        click.option(
            "--home-assistant-password",
            type=click.Path(path_type=Path, dir_okay=False),
            metavar="FILE",
            help="The password for the broker.",
        ),
    )

    def check(self, given: Mapping[str, Any]) -> BrokerAddress | None:
        """The broker; None: it is not wanted."""
        address, password = given["home_assistant"], given["home_assistant_password"]
        if not address:
            return None
        try:
            from msbot_bridges.mqtt.broker import read_address
        except ModuleNotFoundError as error:
            raise ConfigError(
                f"--home-assistant takes the library {error.name}: pip install 'msbot-bridges[mqtt]'"
            ) from error
        return read_address(address, {"password_file": str(password)} if password else {})

    def coroutines(self, wanted: BrokerAddress, context: MasterContext) -> Iterable[Beside]:
        """Show it until cancelled."""
        from msbot_bridges.mqtt.robot_in_ha import RobotInHa

        context.say(f"Home Assistant finds the robot at {wanted.words}")
        return [RobotInHa(context.master, context.operations, wanted).run()]


IN_HOME_ASSISTANT = InHomeAssistant()

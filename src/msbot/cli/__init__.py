"""The `msbot` command. A command's module is imported only when it runs, so `msbot --help` stays quick."""

from __future__ import annotations

import importlib
import sys

import click

from msbot.errors import MsbotError

COMMANDS = {
    "demo": "Run the sample robot on this machine; no hardware needed.",
    "init": "Write a commented robot.toml, the blueprint of a robot.",
    "master": "Run a robot's master: profile, health inventory and agent.",
    "part": "Run one part of a robot.",
    "library": "List, search, check and add part types.",
    "parts": "List the parts a robot's database knows, and how they are.",
    "key": "Make, list and remove the keys of parts, for robots with authentication.",
    "why": "Say in words why a part is, or is not, in the robot.",
    "adopt": "Let a part into a slot, also one the library does not know.",
    "swap": "Give a slot to another part.",
    "release": "Take the part out of a slot.",
    "block": "Let a part, or all parts of a number, in no more.",
    "unblock": "Let a blocked part in again.",
    "set": "Show and set the parameters of a slot.",
    "bind": "Join ports by a topic.",
    "unbind": "Take a port off a topic.",
    "undo": "Take a change back, or show what was changed.",
    "identify": "Have a part show itself: blink, beep.",
    "stop": "STOP: all parts go to their safe states.",
    "check": "Check a blueprint against the part library.",
    "diff": "Show what a blueprint would change, and what was changed by hand.",
    "apply": "Put a changed blueprint into force.",
    "export": "Write a robot of the database down as a blueprint.",
    "robots": "List the robots of a database.",
    "db": "Take care of a robot's database: migrate, copy, restore, check.",
    "bus": "Tools for a CAN bus: watch it, send, decode, count bits, load, simulate.",
    "agent": "Run a DDS-XRCE agent for any micro-ROS client, without a blueprint.",
    "clients": "List the sessions of every agent and master that runs here.",
}
"""Every command and its line in `msbot --help`; the module `msbot.cli.<name>` holds it as `command`."""


class LazyGroup(click.Group):
    """A group whose commands are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        """The commands in the order of a first day with MsBOT."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import and return one command, or None when there is no such name."""
        if cmd_name not in COMMANDS:
            return None
        command = importlib.import_module(f"msbot.cli.{cmd_name}").command
        assert isinstance(command, click.Command)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Print the table above without importing anything."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, COMMANDS[name]) for name in self.list_commands(ctx)])


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="msbot", message="%(prog)s %(version)s")
def msbot() -> None:
    """Plug-and-play robots for the classroom."""


def main() -> None:
    """Entry point: a user's mistake is one message on stderr and exit status 2, never a traceback."""
    try:
        msbot(prog_name="msbot")
    except MsbotError as error:
        click.echo(f"msbot: {error}", err=True)
        sys.exit(2)

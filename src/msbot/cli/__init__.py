"""The `msbot` command. A command's module is imported only when it runs, and click only when any runs, so that
`msbot --help` stays quick."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

from msbot.cli import first_page
from msbot.operations.table import OPERATIONS
from msbot.runtime.extensions import extensions

if TYPE_CHECKING:
    from msbot.cli.group import msbot

__all__ = ["CHANGING", "COMMANDS", "main", "msbot"]

CHANGING = (
    "adopt",
    "swap",
    "release",
    "block",
    "unblock",
    "set",
    "publish",
    "bind",
    "unbind",
    "undo",
    "identify",
    "simulate",
    "stop",
    "go",
)
"""The commands that change a robot: operations of the table."""

COMMANDS = {
    "demo": ("demo.demo", "Run the sample robot on this machine; no hardware needed."),
    "init": ("blueprint.init", "Write a commented robot.toml, the blueprint of a robot."),
    "master": ("run.master", "Run a robot's master: profile, health inventory and agent."),
    "part": ("run.part", "Run one part of a robot, simulated or wired to this computer."),
    "host": ("run.host", "Run all parts that are wired to this computer, from one file."),
    "board": ("board.board", "Put MsBOT and programs on boards with MicroPython; run them, open a prompt."),
    "hardware": ("run.hardware", "Find what is plugged into this computer."),
    "arena": ("arena.arena", "List, check and show the worlds that simulated robots drive in."),
    "library": ("library.library", "List, search, check and add part types."),
    "parts": ("look.parts", "List the parts a robot's database knows, and how they are."),
    "key": ("key", "Make, list and remove the keys of parts, for robots with authentication."),
    "why": ("look.why", "Say in words why a part is, or is not, in the robot."),
    "doctor": ("doctor", "Find what keeps a robot from working, and what mends it."),
    **{name: ("change.verbs", OPERATIONS[name].summary) for name in CHANGING},
    "check": ("blueprint.check", "Check a blueprint against the part library."),
    "diff": ("blueprint.diff", "Show what a blueprint would change, and what was changed by hand."),
    "apply": ("blueprint.apply", "Put a changed blueprint into force."),
    "slot": ("blueprint.slot", "Give a robot a new slot: in its blueprint, and in force at once."),
    "export": ("blueprint.export", "Write a robot of the database down as a blueprint."),
    "robots": ("look.robots", "List the robots of a database."),
    "class": ("school.school", "All robots of a class: list, search, one STOP, one blueprint for many."),
    "user": ("user.user", "List, add and remove the people who may sign in on the page."),
    "pupils": ("user.pupils", "A class at one robot: groups, freeze all, take over, hands; a robot for a class."),
    "service": ("service.service", "Have a robot start with the computer, and back up its database."),
    "db": ("db", "Take care of a robot's database: migrate, copy, restore, check."),
    "rec": ("record.rec", "Keep what the flight recorder has, or record in a file."),
    "log": ("record.log", "Look into recordings: show, cut, compare, export them."),
    "play": ("record.play", "Replay what a part said in a recording, in its place in a running robot."),
    "plot": ("record.plot", "Draw curves of a robot or a recording, or one CAN frame as levels."),
    "fault": ("lab.fault", "Let something go wrong on purpose, for a while: a lost part, noise, a stuck sensor."),
    "mission": ("lab.mission", "Missions: something goes wrong, a class finds and mends it, and is graded."),
    "lesson": ("lesson", "Lessons that check themselves: list them, begin one, see who is where."),
    "idl": ("idl", "Turn message definitions (OMG IDL, ROS 2) into Python, C or IDL."),
    "explain": ("explain", "Explain a message, a frame or a capture: words, fields, bits, cost."),
    "quiz": ("quiz", "Decode messages and frames yourself, and be told how it is done."),
    "bus": ("bus.bus", "Tools for a CAN bus: watch it, send, decode, count bits, load, simulate."),
    "agent": ("agent.agent", "Run a DDS-XRCE agent for any micro-ROS client, without a blueprint."),
    "relay": ("run.relay", "Carry the parts of one link (a CAN bus) to a master on another computer."),
    "gateway": ("wide.gateway", "Carry topics between this site's data space and other sites, by a list."),
    "router": ("wide.router", "Run a Zenoh router, to which the sites of a wide network connect."),
    "clients": ("agent.clients", "List the sessions of every agent and master that runs here."),
    "extensions": ("extension_list", "List the extensions that are installed, and what is wrong with them."),
    "completion": ("completion", "Print what completes `msbot` commands in bash, zsh or fish."),
}
"""Every command: the module below `msbot.cli` that has it, and its line in `msbot --help`."""


_HELP = (["-h"], ["--help"])


def main() -> None:
    """Entry point: a user's mistake is one message on stderr and exit status 2, never a traceback."""
    if sys.stdin is None or sys.stdout is None or sys.stderr is None:
        from msbot.runtime.standard_streams import fill_closed_streams

        fill_closed_streams()
    if sys.argv[1:] in _HELP and "_MSBOT_COMPLETE" not in os.environ:
        first_page.show({name: words for name, (_, words) in COMMANDS.items()} | brought_commands())
        return
    from msbot.cli.group import run

    run()


def brought_commands() -> dict[str, str]:
    """The commands of extensions, with what their packages say of themselves; none is imported."""
    return {
        name: f"{one.summary} ({one.package})".strip() for name, one in extensions().names("commands", COMMANDS).items()
    }


def __getattr__(name: str) -> object:
    if name == "msbot":
        from msbot.cli.group import msbot as found

        return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

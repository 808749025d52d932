"""The `msbot` command. A command's module is imported only when it runs, and click only when any runs, so that
`msbot --help` stays quick."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

from msbot_agent.cli import help_page
from msbot_agent.startup.extensions import extensions

if TYPE_CHECKING:
    from msbot_agent.cli.group import msbot

__all__ = ["BUILT_IN", "COMMANDS", "command_lines", "main", "msbot"]

COMMANDS = {
    "demo": "Run the sample robot on this machine; no hardware needed.",
    "init": "Write a commented robot.toml, the blueprint of a robot.",
    "master": "Run a robot's master: profile, health inventory and agent.",
    "part": "Run one part of a robot, simulated or wired to this computer.",
    "host": "Run all parts that are wired to this computer, from one file.",
    "bridge": "Make devices that speak another protocol parts of a robot.",
    "board": "Put MsBOT and programs on boards with MicroPython; run them, open a prompt.",
    "hardware": "Find what is plugged into this computer.",
    "arena": "List, check and show the worlds that simulated robots drive in.",
    "library": "List, search, check and add part types.",
    "parts": "List the parts a robot's database knows, and how they are.",
    "key": "Make, list and remove the keys of parts, for robots with authentication.",
    "why": "Say in words why a part is, or is not, in the robot.",
    "doctor": "Find what keeps a robot from working, and what mends it.",
    "adopt": "Let a part into a slot, also one the library does not know.",
    "swap": "Give a slot to another part.",
    "release": "Take the part out of a slot.",
    "block": "Keep a part, or all parts of a number, out.",
    "unblock": "Let a blocked part in again.",
    "set": "Show and set the parameters of a slot.",
    "publish": "Drive a port by hand: the fan, the lamp, the servo.",
    "topic": "Look at topics as `ros2 topic` does: list, echo, hz, bw; publish on one.",
    "call": "Send a request to a port that serves, and print its reply.",
    "bind": "Join ports by a topic.",
    "unbind": "Take a port off a topic.",
    "undo": "Take a change back, or show what was changed.",
    "identify": "Have a part show itself: blink, beep.",
    "simulate": "Let a simulated part stand in for that of a slot, or end that.",
    "stop": "STOP: all parts go to their safe states.",
    "go": "End STOP: the parts may work again.",
    "check": "Check a blueprint against the part library.",
    "diff": "Show what a blueprint would change, and what was changed by hand.",
    "apply": "Put a changed blueprint into force.",
    "slot": "Give a robot a new slot: in its blueprint, and in force at once.",
    "export": "Write a robot of the database down as a blueprint.",
    "robots": "List the robots of a database.",
    "class": "All robots of a class: list, search, one STOP, one blueprint for many.",
    "user": "List, add and remove the people who may sign in on the page.",
    "pupils": "A class at one robot: groups, freeze all, take over, hands; a robot for a class.",
    "service": "Have a robot start with the computer, and back up its database.",
    "db": "Take care of a robot's database: migrate, copy, restore, check.",
    "rec": "Keep what the flight recorder has, or record in a file.",
    "log": "Look into recordings: show, cut, compare, export them.",
    "play": "Replay what a part said in a recording, in its place in a running robot.",
    "plot": "Draw curves of a robot or a recording, or one CAN frame as levels.",
    "fault": "Let something go wrong on purpose, for a while: a lost part, noise, a stuck sensor.",
    "mission": "Missions: something goes wrong, a class finds and mends it, and is graded.",
    "lesson": "Lessons that check themselves: list them, begin one, see who is where.",
    "idl": "Turn message definitions (OMG IDL, ROS 2) into Python, C or IDL.",
    "explain": "Explain a message, a frame or a capture: words, fields, bits, cost.",
    "quiz": "Decode messages and frames yourself, and be told how it is done.",
    "bus": "Tools for a CAN bus: watch it, send, decode, count bits, load, simulate.",
    "agent": "Run a DDS-XRCE agent for any micro-ROS client, without a blueprint.",
    "relay": "Carry the parts of one link (a CAN bus) to a master on another computer.",
    "gateway": "Carry topics between this site's data space and other sites, by a list.",
    "router": "Run a Zenoh router, to which the sites of a wide network connect.",
    "clients": "List the sessions of every agent and master that runs here.",
    "extensions": "List the extensions that are installed, and what is wrong with them.",
    "completion": "Print what completes `msbot` commands in bash, zsh or fish.",
}
"""Every command of MsBOT with its line in `msbot --help`, in the order in which a newcomer needs them. Each is
brought by its distribution, by an entry point; those of distributions that are not installed are not there."""

BUILT_IN = {
    "idl": "idl",
    "agent": "agent.agent",
    "relay": "relay",
    "gateway": "wide.gateway",
    "router": "wide.router",
    "clients": "agent.clients",
    "extensions": "extension_list",
    "completion": "completion",
}
"""The commands of this distribution: the module below `msbot_agent.cli` that has it."""


_HELP = (["-h"], ["--help"])


def main() -> None:
    """Entry point: a user's mistake is one message on stderr and exit status 2, never a traceback."""
    if sys.stdin is None or sys.stdout is None or sys.stderr is None:
        from msbot_agent.process.nonblocking_output import fill_closed_streams

        fill_closed_streams()
    if sys.argv[1:] in _HELP and "_MSBOT_COMPLETE" not in os.environ:
        help_page.show(command_lines())
        return
    from msbot_agent.cli.group import run

    run()


IN_SCHOOL = ("class", "fault", "mission", "lesson", "quiz")
IN_BRIDGES = ("bridge",)
IN_WEB = ("demo", "user", "pupils")


def package_of(command: str) -> str:
    """The distribution of MsBOT that brings a command of `COMMANDS`."""
    if command in BUILT_IN:
        return "msbot-agent"
    if command in IN_BRIDGES:
        return "msbot-bridges"
    return "msbot-school" if command in IN_SCHOOL else "msbot-web" if command in IN_WEB else "msbot"


def command_lines() -> dict[str, str]:
    """Every command that is there with its line in `msbot --help`; none is imported.

    Those of extensions come last, with what their packages say of themselves.
    """
    brought = extensions().names("commands", COMMANDS)
    own = {name: words for name, words in COMMANDS.items() if name in BUILT_IN or name in brought}
    others = {
        name: f"{one.summary} ({one.package})".strip()
        for name, one in brought.items()
        if name not in COMMANDS and not one.is_own
    }
    return own | others


def __getattr__(name: str) -> object:
    if name == "msbot":
        from msbot_agent.cli.group import msbot as found

        return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

"""The `msbot` command. A command's module is imported only when it runs, and click only when any runs, so that
`msbot --help` stays quick."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import TYPE_CHECKING

from msbot_agent.cli import help_page
from msbot_agent.startup.extensions import extensions
from msbot_command import end, without_traceback

if TYPE_CHECKING:
    from msbot_agent.cli.group import msbot

__all__ = ["BUILT_IN", "COMMANDS", "OTHERS", "TASKS", "command_lines", "main", "msbot", "task_lines"]

TASKS = {
    "Run": {
        "demo": "Run a simulated sample robot on this machine.",
        "init": "Write a commented robot.toml, the blueprint of a robot.",
        "master": "Run a robot's master: profile, health inventory and agent.",
        "service": "Start a robot with the computer, and back up its database.",
        "arena": "List, check, show and control the worlds in which simulated robots drive.",
    },
    "Parts": {
        "part": "Run one part of a robot, simulated or wired to this computer.",
        "host": "Run all parts that are wired to this computer, from one file.",
        "bridge": "Let devices with other protocols join a robot as parts.",
        "board": "Install MsBOT and programs on boards with MicroPython.",
        "hardware": "Find the hardware that is plugged into this computer.",
        "library": "List, search, check and add part types.",
        "key": "Make, list and remove the keys of parts.",
    },
    "Change": {
        "adopt": "Put a part into a slot, even if the library does not know it.",
        "swap": "Give a slot to another part.",
        "spare": "Let a part of another kind stand by for a slot.",
        "release": "Take the part out of a slot.",
        "block": "Keep out a part, or all parts of one part number.",
        "unblock": "Let a blocked part in again.",
        "simulate": "Replace the part in a slot by a simulated one, or end that.",
        "identify": "Make a part blink or beep, to show which one it is.",
        "set": "Show and set the parameters of a slot.",
        "publish": "Drive a port by hand: the fan, the lamp, the servo.",
        "call": "Send a request to a port that serves, and print its reply.",
        "bind": "Connect ports by a topic.",
        "unbind": "Disconnect a port from a topic.",
        "undo": "Undo a change, or list changes.",
        "stop": "STOP: all parts go to their safe states.",
        "go": "End STOP: the parts may work again.",
    },
    "Look": {
        "parts": "List the parts of a robot and their states.",
        "why": "Explain why a part is in the robot, or is not.",
        "topic": "List, print, measure and publish on topics, as `ros2 topic` does.",
        "robots": "List the robots of a database.",
        "rec": "Save what the flight recorder has, or record to a file.",
        "log": "Show, cut, compare and export recordings; follow the robot's log.",
        "play": "Replay a recorded part in a running robot.",
        "plot": "Draw curves of a robot or a recording, or the levels of a CAN frame.",
    },
    "Teach": {
        "lesson": "List and begin lessons, and see everybody's progress.",
        "mission": "Missions: a class finds and repairs faults, and gets marks.",
        "fault": "Plant a fault for a while: a lost part, noise, a stuck sensor.",
        "quiz": "Answer questions about messages and frames.",
        "class": "List all robots of a class, stop them, change their blueprints.",
        "user": "List, add and remove the people who may sign in on the page.",
        "pupils": "A class at one robot: groups, freeze, take over, raised hands.",
    },
    "Bus": {
        "bus": "Watch, decode, measure and simulate a CAN bus; send frames.",
        "explain": "Explain a message, a frame or a capture: words, fields, bits, cost.",
        "idl": "Turn message definitions (OMG IDL, ROS 2) into Python, C or IDL.",
    },
    "Agent": {
        "agent": "Run a DDS-XRCE agent for any micro-ROS client, without a blueprint.",
        "clients": "List the sessions of every agent and master that runs here.",
        "relay": "Carry the parts of one link (a CAN bus) to a master on another computer.",
        "gateway": "Carry listed topics between this site's data space and other sites.",
        "router": "Run a Zenoh router, which connects sites.",
    },
    "Care": {
        "doctor": "Find what keeps a robot from working, and how to mend it.",
        "check": "Check a blueprint against the part library.",
        "diff": "Show what a blueprint would change, and what was changed by hand.",
        "apply": "Apply a changed blueprint.",
        "slot": "Add a slot to a robot, or remove one.",
        "export": "Write a robot of the database as a blueprint.",
        "db": "Migrate, back up, restore and check a robot's database.",
        "extensions": "List the installed extensions, and what is wrong with them.",
        "help": "Show a page of the handbook, or the help of a command.",
        "completion": "Print the script that completes `msbot` commands in bash, zsh or fish.",
    },
}
"""Every command of MsBOT with its line in `msbot --help`, by the task for which somebody looks for it. Each is brought
by its distribution, by an entry point; those of distributions that are not installed are not there."""

COMMANDS = {name: words for commands in TASKS.values() for name, words in commands.items()}
"""All of them, in the same order."""

OTHERS = "Extensions"
"""The task of an extension's command that names none of `TASKS`."""

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
    """Entry point: a user's mistake is one message on stderr and exit status 2, never a traceback; nor is Ctrl-C."""
    without_traceback()
    try:
        if os.environ.get("_MSBOT_COMPLETE", "").endswith("_complete"):
            _complete()
        _run()
    except KeyboardInterrupt:
        end()


def _complete() -> None:
    """Answer a shell in which somebody has pressed Tab: in no case with words on what is wrong.

    The program ends at once: a thread may still look for names.
    """
    sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 - until the end
    try:
        from msbot_agent.cli.group import msbot

        msbot(prog_name="msbot")
    except (Exception, SystemExit):
        with suppress(OSError):
            sys.stdout.flush()
        os._exit(0)


def _run() -> None:
    if sys.stdin is None or sys.stdout is None or sys.stderr is None:
        from msbot_agent.process.nonblocking_output import fill_closed_streams

        fill_closed_streams()
    if sys.argv[1:] in _HELP and "_MSBOT_COMPLETE" not in os.environ:
        help_page.show(task_lines())
        return
    from msbot_agent.cli.group import run

    run()


IN_SCHOOL = ("class", "fault", "mission", "lesson", "quiz")
IN_BRIDGES = ("bridge",)
IN_WEB = ("demo", "user", "pupils", "help")


def package_of(command: str) -> str:
    """The distribution of MsBOT that brings a command of `COMMANDS`."""
    if command in BUILT_IN:
        return "msbot-agent"
    if command in IN_BRIDGES:
        return "msbot-bridges"
    return "msbot-school" if command in IN_SCHOOL else "msbot-web" if command in IN_WEB else "msbot"


def task_lines() -> dict[str, dict[str, str]]:
    """Every command that is there with its line in `msbot --help`, by task; none is imported.

    Those of extensions have what their packages say of themselves. An entry point says where they belong by a task in
    brackets, `hello = "msbot_hello.command:hello [Teach]"`; else they come last, in a group of their own.
    """
    brought = extensions().names("commands", COMMANDS)
    lines = {
        task: {name: words for name, words in commands.items() if name in BUILT_IN or name in brought}
        for task, commands in TASKS.items()
    }
    for name, one in brought.items():
        if name not in COMMANDS and not one.is_own:
            task = one.target.partition("[")[2].strip(" ]")
            lines.setdefault(task if task in TASKS else OTHERS, {})[name] = f"{one.summary} ({one.package})".strip()
    return {task: commands for task, commands in lines.items() if commands}


def command_lines() -> dict[str, str]:
    """The same without the tasks."""
    return {name: words for commands in task_lines().values() for name, words in commands.items()}


def __getattr__(name: str) -> object:
    if name == "msbot":
        from msbot_agent.cli.group import msbot as found

        return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

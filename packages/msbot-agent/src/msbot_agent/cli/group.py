"""The group of all commands, as click sees it."""

from __future__ import annotations

import errno
import importlib
import io
import os
import shlex
import sys
from importlib.util import find_spec
from pathlib import Path

import click
from click.core import ParameterSource
from click.shell_completion import CompletionItem

from msbot_agent.cli import BUILT_IN, COMMANDS, command_lines, package_of, task_lines
from msbot_agent.cli.build_name import print_version
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.help_page import SUMMARY, command_list, leave_output
from msbot_agent.startup.bytecode_cache import without_garbage_collection
from msbot_agent.startup.extensions import extensions
from msbot_agent.text.sentence import printable, whole
from msbot_agent.text.similar_names import did_you_mean, nearest
from msbot_command import end, is_interrupt
from msbot_xrce.errors import MsbotError

NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""What the system says when a disk is full, or its share of a user."""

LONGEST_NAME = 100
"""Of a name in a sentence, in letters."""


class LazyGroup(click.Group):
    """A group whose commands are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002 - click's signature
        """The commands in the order of `msbot --help`."""
        return list(command_lines())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """Import and return one command, or None when there is no such name."""
        if cmd_name not in COMMANDS:
            return extensions().get("commands", cmd_name, click.Command)
        with without_garbage_collection():
            if cmd_name in BUILT_IN:
                command = importlib.import_module(f"msbot_agent.cli.{BUILT_IN[cmd_name]}").command
            else:
                brought = extensions().names("commands", COMMANDS).get(cmd_name)
                command = None if brought is None else brought.load()
        assert isinstance(command, click.Command | None)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; of one whose package is not installed its package is named."""
        name = args[0] if args else ""
        if name in COMMANDS and self.get_command(ctx, name) is None:
            package = package_of(name)
            raise click.UsageError(f"`msbot {name}` is in the package {package}, which is not installed here.", ctx)
        if name and not name.startswith("-") and name not in command_lines():
            near = [f"'{one}'" for one in nearest(name, command_lines())]
            hint = f" D{did_you_mean(near)[1:]}" if near else ""
            raise click.UsageError(f"No such command '{printable_name(name)}'.{hint}", ctx)
        return super().resolve_command(ctx, args)

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        """The commands that begin with `incomplete`, from the table above; click would import them all."""
        if not incomplete.startswith("-"):
            return [
                CompletionItem(name, help=words)
                for name, words in command_lines().items()
                if name.startswith(incomplete)
            ]
        return super().shell_complete(ctx, incomplete)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002
        """Print them by task without importing anything."""
        formatter.write("\n".join([*command_list(task_lines(), formatter.width), ""]))


@click.group(cls=LazyGroup, help=SUMMARY, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=print_version,
    help="Show the version and exit.",
)
def msbot() -> None:
    """Every command."""


def run() -> None:
    """Run what the command line says; a mistake of the user's ends in one sentence and status 2."""
    print_anything()
    try:
        status = msbot(prog_name="msbot", standalone_mode=False)
    except click.exceptions.NoArgsIsHelpError as error:  # a group without a command: its commands are listed
        error.show()
        sys.exit(error.exit_code)
    except click.UsageError as error:
        words = usage_words(error)
    except click.ClickException as error:
        words = error.format_message()
    except click.Abort as error:
        if is_interrupt(error):
            end()
        complain("broken off before it was done")
        sys.exit(ExitStatus.NO)
    except MsbotError as error:
        words = str(error)
    except OSError as error:
        if error.filename is not None:
            # A name that was given on the command line: nobody may look into its folder, or it is too long.
            words = f"{printable_name(error.filename)}: {error.strerror}"
        elif error.errno in NO_ROOM:
            words = f"what was to be printed or written has no room: {error.strerror}"
            leave_output()
        else:
            raise
    except UnicodeEncodeError as error:
        if error.reason != "surrogates not allowed":
            raise
        wrong = next((text for text in sys.argv if whole(text) != text), error.object)
        words = f"{printable_name(wrong)} is not UTF-8, as names and texts must be"
    except Exception as error:
        brought = extensions().names("commands", COMMANDS).get(sys.argv[1] if len(sys.argv) > 1 else "")
        if brought is None or brought.is_own or is_interrupt(error):
            raise
        words = f"the command {brought.name} of {brought.package} failed: {type(error).__name__}: {error}"
    else:
        # Where click does not end the program itself, what `ctx.exit()` was told comes back.
        sys.exit(status if isinstance(status, int) else ExitStatus.DONE)
    complain(words)
    sys.exit(ExitStatus.MISTAKE)


def print_anything() -> None:
    """Print `?` for what standard output cannot encode (a terminal with cp1252, a locale C), instead of failing."""
    if isinstance(sys.stdout, io.TextIOWrapper) and not sys.stdout.encoding.lower().startswith("utf"):
        sys.stdout.reconfigure(errors="replace")


def complain(words: str) -> None:
    """Say on standard error what is wrong."""
    click.echo(f"msbot: {words}{pip_elsewhere(words)}", err=True)


def pip_elsewhere(words: str) -> str:
    """What to write in place of `pip`, if it is needed and this environment has none: that of `make` has none."""
    if "pip install" not in words or find_spec("pip") is not None:
        return ""
    base = Path(sys.base_prefix, "bin", "python3")
    python = shlex.join([str(base) if base.exists() else "python3", "-m", "pip", "--python", sys.executable])
    return f"\nThis environment has no pip of its own: in place of `pip` write `{python}`"


def usage_words(error: click.UsageError) -> str:
    """What is wrong with a command line, in one line, and how to find what would be right."""
    context = error.ctx
    if isinstance(error, click.BadParameter) and error.param is not None and context is not None and error.param.name:
        source = context.get_parameter_source(error.param.name)
        if source is ParameterSource.ENVIRONMENT and isinstance(error.param.envvar, str):
            error.param_hint = f"the environment variable {error.param.envvar}"
    words = " ".join(error.format_message().split())
    if not words.endswith((".", "?", "!", "?)")):
        words += "."
    return words if context is None else f"{words} Try `{context.command_path} --help`."


def printable_name(name: object) -> str:
    """A name as it can be printed anywhere: no control characters, no octets that are no letters, not too long."""
    text = printable(os.fsdecode(name) if isinstance(name, bytes | os.PathLike) else str(name))
    return text if len(text) <= LONGEST_NAME else f"{text[:LONGEST_NAME]}... ({len(text)} letters)"

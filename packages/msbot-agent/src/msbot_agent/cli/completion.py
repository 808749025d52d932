"""`msbot completion`: what a shell needs to complete commands and options."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

SHELLS = ("bash", "zsh", "fish")
VARIABLE = "_MSBOT_COMPLETE"


@click.command("completion")
@click.argument("shell", type=click.Choice(SHELLS))
def command(shell: str) -> None:
    """Print a completion script for SHELL; its first lines say how to install it."""
    from msbot_agent.cli import msbot

    kind = get_completion_class(shell)
    assert kind is not None
    completion = kind(msbot, {}, "msbot", VARIABLE)
    click.echo(f"# {INSTALL[shell]}\n{completion.source_template % completion.source_vars()}")


INSTALL = {
    "bash": 'Put into ~/.bashrc:  eval "$(msbot completion bash)"',
    "zsh": 'Put into ~/.zshrc, behind compinit:  eval "$(msbot completion zsh)"',
    "fish": "Once:  msbot completion fish > ~/.config/fish/completions/msbot.fish",
}

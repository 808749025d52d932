"""`msbot init`: write the sample blueprint."""

from __future__ import annotations

from pathlib import Path

import click

from msbot.config import write_sample


@click.command("init")
@click.argument("path", type=click.Path(path_type=Path), default="robot.toml")
def command(path: Path) -> None:
    """Write a commented blueprint to PATH (robot.toml by default); an existing file is never overwritten."""
    write_sample(path)
    click.echo(f"{path} is written: the thesis' sample robot, with every key explained.")
    click.echo(f"Next: msbot master {path}    and in other terminals: msbot part AA, msbot part BB, msbot part CC")

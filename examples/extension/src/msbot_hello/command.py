"""`msbot hello NAME`."""

import click


@click.command("hello")
@click.argument("name")
def hello(name: str) -> None:
    """Greet NAME."""
    click.echo(f"Hello, {name}!")

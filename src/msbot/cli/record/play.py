"""`msbot play`: what parts once said, said again in a running robot."""

from __future__ import annotations

from collections.abc import Coroutine
from pathlib import Path
from typing import TYPE_CHECKING

import click

from msbot.cli.options import DEFAULT_LINK
from msbot.errors import ConfigError

if TYPE_CHECKING:
    from msbot.lab.replay.player import Player

SLOWEST = 0.01
FASTEST = 1000.0
NOTICEABLE_S = 0.1
"""A delay of a sample that is told at the end."""


@click.command("play")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--slot", "slots", multiple=True, metavar="SLOT",
              help="Whose part is replayed; may be given several times; not needed if there is one.")  # fmt: skip
@click.option("--speed", type=click.FloatRange(SLOWEST, FASTEST), default=1.0, show_default=True,
              help="How many times as fast as it was; 0.5 is half as fast.")  # fmt: skip
@click.option("--from", "from_s", type=click.FloatRange(min=0), metavar="SECONDS",
              help="From this time in the recording on.")  # fmt: skip
@click.option("--to", "to_s", type=click.FloatRange(min=0), metavar="SECONDS", help="Until this time in the recording.")
@click.option("--link", default=DEFAULT_LINK, show_default=True, envvar="MSBOT_LINK", show_envvar=True,
              help="The way to the master.")  # fmt: skip
@click.option("--uid", help="16 hexadecimal digits; drawn once and kept on this computer unless given.")
@click.option("--key", help="File with the part's key, or the key itself; $MSBOT_KEY unless given.")
@click.option("-q", "--quiet", is_flag=True, help="Say only what is wrong.")
def command(
    file: Path,
    *,
    slots: tuple[str, ...],
    speed: float,
    from_s: float | None,
    to_s: float | None,
    link: str,
    uid: str | None,
    key: str | None,
    quiet: bool,
) -> None:
    """Replay what the part in a slot said, in a robot that runs: a recording takes the part's place.

    The replayed part joins the robot like any other and publishes the recorded messages at their recorded times; while
    STOP holds it is silent and the recording stands still. The command ends when all is said.
    """
    from msbot.cli.run.hosting import connect, identify, run_until_told
    from msbot.lab.replay.piece import read_piece
    from msbot.lab.replay.player import Player
    from msbot.part.join.uid import stored_uid

    if len(slots) > 1 and (uid is not None or key is not None):
        raise ConfigError(f"--uid and --key are for a replay of one slot, this one has {len(slots)}")
    piece = read_piece(file, slots, from_s=from_s, to_s=to_s)
    if piece.damage:
        click.echo(f"msbot: {file} is damaged: {piece.damage}; what came before is replayed", err=True)
    players: list[Player] = []

    def make() -> tuple[Player, Coroutine[object, object, None]]:
        player = Player(
            piece,
            speed=speed,
            say=lambda words: None if quiet else click.echo(words),
            warn=lambda words: click.echo(f"msbot: {words}", err=True),
        )
        for slot, part in player.parts.items():
            # Not the UID of the real one: both may be present, and the robot must be able to distinguish them.
            own = uid or stored_uid(part.part_number, f"{slot} {part.local_name}, replayed").hex()
            identify(part, uid=own, key=key)
        players.append(player)
        return player, player.run(lambda part: connect(part, link))

    if not quiet:
        names = ", ".join(f"{slot.name} ({slot.part_number})" for slot in piece.slots)
        pace = "" if speed == 1 else f", {speed:g} times as fast"
        click.echo(f"{names}: {len(piece.samples)} messages of {piece.seconds:.1f} s{pace}")
    run_until_told(make, quiet=quiet)
    if players and not quiet:
        click.echo(_outcome(players[0]))


def _outcome(player: Player) -> str:
    words = "The replay is over" if player.ended else "The replay was ended before its end"
    left_out = sum(player.left_out.values())
    words += f": {player.published} messages published"
    if left_out:
        words += f", {left_out} left out"
    if player.late_s > NOTICEABLE_S:
        words += f", the latest {player.late_s:.1f} s late"
    return words

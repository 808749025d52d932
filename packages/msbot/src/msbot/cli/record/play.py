"""`msbot play`: what parts once said, and what people did, again in a running robot."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Coroutine, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from msbot.cli import completers
from msbot.cli.robot_options import link_option, robot_options
from msbot_agent.cli.exit_status import ExitStatus
from msbot_agent.cli.options import FiniteRange
from msbot_agent.text.sentence import printable
from msbot_xrce.counting import amount
from msbot_xrce.errors import ConfigError, MsbotError

if TYPE_CHECKING:
    from msbot.recording.replay.recorded_operations import OperationPlayer, RecordedOperations
    from msbot.recording.replay.replay_excerpt import ReplayExcerpt
    from msbot.recording.replay.replay_player import ReplayPlayer
    from msbot_agent.agent import RunningProcess

SLOWEST = 0.01
FASTEST = 1000.0
NOTICEABLE_S = 0.1
"""A delay of a sample that is told at the end."""


@click.command("play")
@click.argument("file", shell_complete=completers.recordings, type=click.Path(path_type=Path))
@click.option(
    "--slot",
    "slots",
    multiple=True,
    metavar="SLOT",
    help="The slot to replay; repeatable; not needed if the recording has only one.",
)
@click.option(
    "--speed",
    type=FiniteRange(SLOWEST, FASTEST),
    default=1.0,
    show_default=True,
    help="Playback speed; 0.5 is half as fast.",
)
@click.option(
    "--from", "from_s", type=FiniteRange(min=0), metavar="SECONDS", help="From this time in the recording on."
)
@click.option("--to", "to_s", type=FiniteRange(min=0), metavar="SECONDS", help="Until this time in the recording.")
@link_option
@click.option(
    "--uid", help="UID, 16 hexadecimal digits; default: random at the first start, then kept on this computer."
)
@click.option("--key", help="File with the part's key, or the key itself; default: $MSBOT_KEY.")
@click.option(
    "--acts", "with_acts", is_flag=True, help="Repeat what people did: settings, wires, values by hand, STOP and GO."
)
@click.option("-q", "--quiet", is_flag=True, help="Print only problems.")
@robot_options
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
    with_acts: bool,
    quiet: bool,
    db: str | None,
    robot: str | None,
) -> None:
    """Replay a recorded part in a running robot, in its place.

    The replayed part joins the robot like any other and publishes the recorded messages at their recorded times;
    while STOP holds, the replay pauses. The command ends with the recording.

    With --acts, what people did is repeated at the recorded times in the robot that runs here, as "NAME, replayed";
    with --slot, both in step.
    """
    from msbot.cli.run.host import run_until_told
    from msbot.recording.replay.recorded_operations import read_operations
    from msbot.recording.replay.replay_excerpt import read_excerpt

    if len(slots) > 1 and (uid is not None or key is not None):
        raise ConfigError(f"--uid and --key are for a replay of one slot, this one has {len(slots)}")
    if not with_acts and (db is not None or robot is not None):
        raise ConfigError("--db and --robot say in which robot people's acts are done again: they need --acts")
    acts = read_operations(file, from_s=from_s, to_s=to_s) if with_acts else None
    piece = read_excerpt(file, slots, from_s=from_s, to_s=to_s) if slots or acts is None else None
    damage = piece.damage if piece is not None else acts.damage if acts is not None else ""
    if damage:
        click.echo(f"msbot: {file} is damaged: {damage}, and is replayed", err=True)
    if piece is not None and piece.left_out:
        from msbot.recording.recordings.summary import named_topics

        words = "the recording does not tell which port they came from, or how to read them"
        click.echo(f"left out, since {words}: {named_topics(piece.left_out)}", err=True)
    replay = _Replay(quiet=quiet, speed=speed)
    master = None if acts is None else _master(db, robot)

    def make() -> tuple[_Replay, Coroutine[object, object, None]]:
        if piece is not None:
            replay.play(piece, uid=uid, key=key)
        if acts is not None and master is not None:
            replay.act(acts, master, None if piece is None else piece.begin_ns)
        return replay, replay.run(link)

    if not quiet:
        for line in _plan(piece, acts, speed):
            click.echo(line)
    run_until_told(make, quiet=quiet)
    if not quiet:
        for line in replay.outcome():
            click.echo(line)
    if damage:
        sys.exit(ExitStatus.NO)


class _Replay:
    """The parts and the acts of one replay, which end together."""

    def __init__(self, *, quiet: bool, speed: float) -> None:
        self._quiet = quiet
        self._speed = speed
        self._player: ReplayPlayer | None = None
        self._acts: OperationPlayer | None = None
        self._fault: MsbotError | None = None

    def play(self, piece: ReplayExcerpt, *, uid: str | None, key: str | None) -> None:
        """Replay parts."""
        from msbot.cli.run.host import identify
        from msbot.part.join.uid import stored_uid
        from msbot.recording.replay.replay_player import ReplayPlayer

        self._player = ReplayPlayer(
            piece,
            speed=self._speed,
            say=self._say,
            warn=_warn,
            is_own_stop=lambda: self._acts is not None and self._acts.holds_stop,
        )
        for slot, part in self._player.parts.items():
            # Not the UID of the real one: both may be present, and the robot must be able to distinguish them.
            own = uid or stored_uid(part.part_number, f"{slot} {part.local_name}, replayed").hex()
            identify(part, uid=own, key=key)

    def act(self, acts: RecordedOperations, master: RunningProcess, begin_ns: int | None) -> None:
        """Do again what people did."""
        from msbot.recording.replay.recorded_operations import OperationPlayer

        player = self._player

        async def ask(request: Mapping[str, object]) -> Mapping[str, object]:
            return await asyncio.to_thread(master.ask, dict(request))

        self._acts = OperationPlayer(
            acts,
            ask,
            speed=self._speed,
            say=self._say,
            begin_ns=begin_ns,
            may_go=lambda: player is None or player.is_going or player.ended,
        )

    async def run(self, link: str) -> None:
        """Until all is said and done, or something does not fit."""
        from msbot.cli.run.host import connect

        player, acts = self._player, self._acts
        both = [] if player is None else [player.run(lambda part: connect(part, link))]
        both += [] if acts is None else [acts.run()]
        await asyncio.gather(*(self._until_over(one) for one in both))
        if self._fault is not None:
            raise self._fault

    async def _until_over(self, work: Coroutine[object, object, None]) -> None:
        """What does not fit ends the other one, too, in good order: parts say goodbye."""
        try:
            await work
        except MsbotError as error:
            self._fault = self._fault or error
            self.end()

    def end(self) -> None:
        """End before everything is done."""
        for one in (self._player, self._acts):
            if one is not None:
                one.end()

    def outcome(self) -> list[str]:
        """What came of it."""
        lines = [] if self._player is None else [_outcome(self._player)]
        if self._acts is not None:
            word = "over" if self._acts.ended else "ended before its end"
            lines.append(f"The replay of acts is {word}: {amount(self._acts.done, 'act')} done")
        return lines

    def _say(self, words: str) -> None:
        if not self._quiet:
            click.echo(words)


def _warn(words: str) -> None:
    click.echo(f"msbot: {words}", err=True)


def _master(db: str | None, robot: str | None) -> RunningProcess:
    """The master in whose robot acts are done again."""
    from msbot.cli.change.robot_access import running_master

    found = running_master(db, robot)
    if found is None:
        raise ConfigError("no master runs here: what people did is done again in a robot that runs on this computer")
    return found


def _plan(piece: ReplayExcerpt | None, acts: RecordedOperations | None, speed: float) -> list[str]:
    """What is going to happen."""
    pace = "" if speed == 1 else f", {speed:g} times as fast"
    lines = []
    if piece is not None:
        names = ", ".join(f"{slot.name} ({slot.part_number})" for slot in piece.slots)
        lines.append(f"{names}: {amount(len(piece.samples), 'message')} of {piece.seconds:.1f} s{pace}")
    if acts is not None:
        people = ", ".join(dict.fromkeys(one.who for one in acts.acts))
        lines.append(f"{amount(len(acts.acts), 'act')} of {people}{pace}")
        lines += [f"left out, cannot be done again: {name} ({count})" for name, count in acts.left_out.items()]
    return [printable(line) for line in lines]


def _outcome(player: ReplayPlayer) -> str:
    words = "The replay is over" if player.ended else "The replay was ended before its end"
    left_out = ", ".join(f"{slot}.{port} ({count})" for (slot, port), count in player.left_out.items())
    words += f": {amount(player.published, 'message')} published"
    if left_out:
        words += f", left out {printable(left_out)}"
    if player.late_s > NOTICEABLE_S:
        words += f", the latest {player.late_s:.1f} s late"
    return words

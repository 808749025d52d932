"""The flight recorder, as people start and stop it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

from msbot.operations.outcome import Outcome
from msbot_agent.text.sentence import said
from msbot_xrce.errors import ConfigError


class RecorderControl(Protocol):
    """What records this robot."""

    def record(self, path: Path) -> None:
        """Record in one more file from now on."""

    def end_record(self) -> str:
        """End that file; its path, empty if there was none."""

    def as_json(self) -> Mapping[str, object]:
        """Where it records, and what is wrong with it."""


class Recording:
    """The operations of a robot's flight recorder."""

    def __init__(self) -> None:
        self._recorder: RecorderControl | None = None

    def use(self, recorder: RecorderControl) -> None:
        """Say what records this robot."""
        self._recorder = recorder

    def record(self, file: str, who: str) -> Outcome:  # noqa: ARG002 - what every operation is given
        """Record in a file of its own, in addition to the ring; one that was recorded so far ends."""
        path = Path(file)
        if not path.is_absolute():
            raise ConfigError(said("{file}: the file is named with its whole path", file=file))
        if not path.parent.is_dir():
            raise ConfigError(said("{file}: there is no folder {folder}", file=file, folder=str(path.parent)))
        if path.exists():
            raise ConfigError(said("{file} is there already: give the recording another name", file=file))
        recorder = self._the_recorder()
        ended = recorder.end_record()
        recorder.record(path)
        if ended:
            return Outcome(
                said("{ended} is complete; everything is recorded in {file} from now on", ended=ended, file=file)
            )
        return Outcome(said("everything is recorded in {file} from now on", file=file))

    def end_record(self, who: str) -> Outcome:  # noqa: ARG002 - as above
        """End that file."""
        file = self._the_recorder().end_record()
        if not file:
            raise ConfigError(said("nothing is recorded but the ring: `msbot rec save` keeps that"))
        return Outcome(said("{file} is complete", file=file))

    def recording(self) -> Outcome:
        """Where the robot is recorded; an empty answer: nowhere."""
        return Outcome(answer={} if self._recorder is None else dict(self._recorder.as_json()))

    def _the_recorder(self) -> RecorderControl:
        if self._recorder is None:
            raise ConfigError(said("this robot runs with `--rec off`: it has no recorder"))
        return self._recorder

"""The API's STOP is answered when it is stored, or when it is known not to be; the loop never waits for the disk."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from threading import Event

import pytest

from msbot.config import SAMPLE_ROBOT_TOML, load_library, parse_blueprint
from msbot.master import Master
from msbot.master.stop_persistence import StopFile
from msbot.operations.dispatch import InProcessOperations
from msbot.pnp import MemoryStore, StopRecord
from msbot_web.api.stop_route import _given


@pytest.mark.parametrize("fails", [False, True])
def test_the_answer_waits_for_the_disk_and_the_robot_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, *, fails: bool
) -> None:
    may_go_on, written = Event(), StopFile.write

    def slow(file: StopFile, record: StopRecord) -> None:
        assert may_go_on.wait(60)
        if fails:
            raise OSError(28, "No space left on device")
        written(file, record)

    class Full(MemoryStore):
        def is_kept(self, timeout_s: float) -> bool:
            return not fails

    async def scene() -> None:
        monkeypatch.setattr(StopFile, "write", slow)
        monkeypatch.setattr("msbot.operations.stop_and_go.ANSWER_S", 60.0)
        master = Master(parse_blueprint(SAMPLE_ROBOT_TOML, load_library()), Full(), stop_file=tmp_path / "stop.json")
        operations = InProcessOperations(master)
        saying = asyncio.ensure_future(operations.do("stop", who="ann", reason="fire"))
        await asyncio.sleep(0)
        assert master.stop.stopped, "it is said before anything is stored"
        assert not saying.done()
        assert not master.stop.is_stored
        may_go_on.set()
        outcome = await saying
        assert outcome.answer["stored"] is not fails
        assert ("No space left on device" in outcome.words) is fails
        if not fails:
            record = StopFile(tmp_path / "stop.json").read()
            assert record is not None
            assert (record.holds, record.by) == (True, "ann")

    asyncio.run(scene())


class Body:
    """A request whose body comes in pieces, or not at all."""

    def __init__(self, *pieces: bytes, ends: bool = True) -> None:
        self.pieces, self.ends = pieces, ends

    async def stream(self) -> AsyncIterator[bytes]:
        for piece in self.pieces:
            yield piece
        if not self.ends:
            await asyncio.Event().wait()


@pytest.mark.parametrize(
    ("body", "given"),
    [
        (Body(b'{"reas', b'on": "fire"}'), {"reason": "fire"}),
        (Body(b'{"reason": "fire"}', ends=False), {"reason": "fire"}),
        (Body(b'{"reason": ', ends=False), {}),
        (Body(ends=False), {}),
        (Body(*(b"x" * 1000 for _ in range(1000)), ends=False), {}),
        (Body(b"\xff\xfe"), {}),
        (Body(b"[" * 20_000), {}),
        (Body(b'["reason"]'), {}),
    ],
)
def test_a_body_that_does_not_come_or_makes_no_sense_says_nothing(body: Body, given: dict[str, str]) -> None:
    assert asyncio.run(_given(body)) == given  # type: ignore[arg-type]

"""The fuzzer itself, and a short run of every target with a fixed seed: the same cases every time."""

from __future__ import annotations

import asyncio
import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, suppress
from pathlib import Path
from random import Random
from typing import get_args

import pytest

from fuzz import engine
from fuzz.__main__ import main
from fuzz.case import Case, Step, Violation, load
from fuzz.corpus import packets
from fuzz.engine import Hang, fuzz, run_case, time_limit
from fuzz.mutate import mutate_case, mutate_octets
from fuzz.targets import TARGETS
from fuzz.targets.parser import file_of
from fuzz.targets.parsers import PARSERS, samples_of
from fuzz.targets.part import ANSWERS, honest_answer
from fuzz.virtual import play
from msbot.part import Message
from msbot.part.join.pnp_messages import (
    LEAST_DESCRIPTION,
    NO_BINDING,
    DescriptionMessage,
    Notice,
    NoticeKind,
    ProfileMessage,
    Reply,
    Request,
    decode_reply,
    decode_request,
)
from msbot_xrce.errors import RemoteProtocolError

EXECUTIONS = {
    "agent": 20,
    "client": 75,
    "part": 6,
    "can": 100,
    "socketcan": 75,
    "simbus": 20,
    "codec": 2000,
    "compact": 1000,
    "serial": 200,
    "mqtt": 60,
    "requests": 250,
    "message": 2000,
    "toml": 12,
    "parsers": 350,
    "page": 1,
    "sockets": 6,
}
"""About half a second each."""


@pytest.mark.parametrize("name", TARGETS)
def test_a_short_run_finds_nothing(name: str, tmp_path: Path) -> None:
    report = fuzz(TARGETS[name], seed=20, findings=tmp_path, executions=EXECUTIONS[name])
    assert report.findings == {}
    assert report.executions == EXECUTIONS[name]
    assert len(report.seen) > 5


def test_the_harness_of_the_part_knows_every_message_between_a_part_and_the_inventory() -> None:
    """Each has a length that tells what it is, so that octets of all lengths are all of them."""
    text = DescriptionMessage(text="x" * LEAST_DESCRIPTION)
    asked = {type(request): request for request in (*_read(decode_request), text)}
    assert set(asked) == set(get_args(Request))
    answers = [honest_answer(request.encode()) for request in asked.values()]
    assert sum(answer is not None for answer in answers) > 3
    assert {type(decode_reply(octets)) for octets in ANSWERS} == set(get_args(Reply))
    notices = [found for octets in ANSWERS if isinstance(found := decode_reply(octets), Notice)]
    assert {notice.kind for notice in notices} == set(NoticeKind)


def _read(decode: Callable[[bytes], Message]) -> Iterator[Message]:
    for length in range(700):
        with suppress(RemoteProtocolError):
            yield decode(bytes(length))


def test_the_beat_of_a_part_that_has_stopped_is_answered_by_the_harness() -> None:
    stop = Notice(number=1, binding=NO_BINDING, kind=NoticeKind.STOP).encode()
    profile = ProfileMessage(index=1, message="MSBOT_MASTER", name="MSBOT_V1", id="X", dof="8-4-2021", make="M")
    case = (Step("profile", profile.encode()), Step("honest"), Step("answer", stop), Step("honest"))
    seen, finding = run_case(TARGETS["part"], case)
    assert finding is None
    assert any(words.startswith("active") for words in seen)


class Fragile:
    """A target with a bug: it cannot stand the octet 7 after a step `arm`."""

    name = "fragile"
    about = "for this test"

    def make(self, random: Random) -> Case:
        verbs = random.choices(("arm", "noise"), k=20)
        return tuple(Step(verb, random.randbytes(40), (1.5,)) for verb in verbs)

    def run(self, case: Case) -> Iterable[str]:
        armed = False
        for step in case:
            if armed and 7 in step.data:
                raise Violation(f"byte at {step.data.index(7)}")
            armed = armed or step.verb == "arm"
        return {f"{len(case)} steps"}


def test_a_bug_is_found_made_small_stored_once_and_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(TARGETS, "fragile", Fragile())
    assert main(["fragile", "--executions", "100", "--findings", str(tmp_path)]) == 1
    (path,) = tmp_path.iterdir()
    told = capsys.readouterr().out
    assert "1 findings" in told
    assert f"python -m fuzz --replay {path}" in told
    name, case = load(path)
    assert name == "fragile"
    assert len(case) == 2
    assert case[0] == Step("arm", b"", (1.5,))
    assert case[1].data[-1] == 7
    assert main(["--replay", str(path)]) == 1
    assert "Violation: byte at" in capsys.readouterr().out
    monkeypatch.setitem(TARGETS, "fragile", TARGETS["serial"])
    assert main(["--replay", str(path)]) == 0
    assert "nothing goes wrong any more" in capsys.readouterr().out


def test_making_a_finding_small_ends_in_time_however_long_a_run_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, runs = 0.0, 0

    class Endless(Fragile):
        """Each run takes as long as it is allowed."""

        def run(self, case: Case) -> Iterable[str]:
            nonlocal now, runs
            now, runs = now + engine.HANG_S, runs + 1
            raise Hang("more than 20 s")

    monkeypatch.setattr("fuzz.engine.time.monotonic", lambda: now)
    report = fuzz(Endless(), seed=1, findings=tmp_path, executions=1)
    assert len(report.files) == 1, "what was found is stored all the same"
    assert runs <= 2 + engine.SMALLER_S / engine.HANG_S


def test_backups_of_an_older_schema_leave_nothing_behind(tmp_path: Path) -> None:
    """Each leaves a copy beside it; after thousands, looking for an unused name took most of the time."""
    backup = tmp_path / "older.db"
    backup.write_bytes(samples_of("backup")[0])
    with closing(sqlite3.connect(backup)) as connection, connection:
        (newest,) = connection.execute("SELECT version_num FROM alembic_version").fetchone()
        connection.execute(f"UPDATE alembic_version SET version_num = '{int(newest) - 1:04}'")
    for _ in range(2):
        list(PARSERS["backup"].read(backup.read_bytes()))
    place = file_of(b"", ".db")
    assert [path.name for path in place.parent.iterdir() if path.name.startswith(place.name)] == [place.name]


def test_what_is_long_stays_long_when_it_is_changed() -> None:
    random = Random(3)
    long = bytes(200_000)
    changed = [mutate_octets(random, long, (b"x",)) for _ in range(200)]
    assert max(map(len, changed)) <= len(long)
    assert sum(len(one) == len(long) for one in changed) > 50


def test_targets_are_listed_and_an_unknown_one_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--list"]) == 0
    told = capsys.readouterr().out
    assert all(name in told for name in TARGETS)
    assert main(["agnet"]) == 2
    assert "no such target: agnet" in capsys.readouterr().err


def test_the_same_seed_gives_the_same_run(tmp_path: Path) -> None:
    first, second = (fuzz(TARGETS["requests"], seed=5, findings=tmp_path, executions=60) for _ in range(2))
    assert (first.steps, first.seen) == (second.steps, second.seen)


def test_mutation_stays_within_its_limits() -> None:
    random = Random(3)
    octets = b""
    case: Case = (Step("a", b"12345678", (1.0,)),)
    for _ in range(500):
        octets = mutate_octets(random, octets, (b"other",))
        case = mutate_case(random, [case, (Step("b"),), ()])
        assert len(octets) <= 70_000
        assert len(case) <= 200


def test_the_corpus_has_every_kind_of_submessage() -> None:
    kinds = {packet[4] for packet in packets(of_clients=True) if len(packet) > 4 and packet[0] >= 0x80}
    assert kinds >= {0x00, 0x01, 0x02, 0x03, 0x07, 0x08, 0x0A, 0x0B, 0x0C, 0x0D, 0x0E}
    kinds = {packet[4] for packet in packets(of_clients=False) if len(packet) > 4 and packet[0] >= 0x80}
    assert kinds >= {0x04, 0x05, 0x06, 0x09, 0x0A, 0x0B, 0x0D, 0x0F}


def test_what_never_ends_is_noticed() -> None:
    def spin() -> None:
        with time_limit(0.01):
            while True:
                pass

    async def rounds() -> None:
        for _ in range(1000):
            await asyncio.sleep(0)

    with pytest.raises(Hang):
        spin()

    with pytest.raises(Violation, match="step budget"):
        play(rounds(), turns=100)


def test_what_a_call_back_raises_is_a_finding() -> None:
    async def scene() -> None:
        asyncio.get_running_loop().call_soon(lambda: 1 / 0)
        await asyncio.sleep(1.0)

    with pytest.raises(ZeroDivisionError):
        play(scene())


def test_an_error_inside_of_a_group_is_named(tmp_path: Path) -> None:
    class Grouped(Fragile):
        def run(self, case: Case) -> Iterable[str]:
            raise ExceptionGroup("many", [ValueError("one of 12")])

    _, finding = run_case(Grouped(), ())
    assert finding is not None
    assert finding.signature == "ValueError in ?: one of #"


def test_a_case_that_only_waits_for_the_processor_does_not_count_as_endless() -> None:
    with time_limit(0.05):
        time.sleep(0.2)

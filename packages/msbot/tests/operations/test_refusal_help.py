"""A part that is not let in is told at its own terminal who has its slot, and what to type."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from msbot.part.join.joining import JoinState
from msbot.part.join.pnp_messages import ConfigurationMessage
from msbot.pnp.refusal_help import LONGEST, help_message
from msbot_xrce.errors import RemoteProtocolError
from tests.homes import micro
from tests.operations.stage import AA_IS_A_DIAL, Stage, play

WAIT_S = 3.0
"""A refused part claims again every 2 s."""
TOLD = "the robot says: "


def heard(caplog: pytest.LogCaptureFixture) -> list[str]:
    lines = [one.getMessage() for one in caplog.records if one.name.startswith("msbot.part")]
    return [line.removeprefix(TOLD) for line in lines if line.startswith(TOLD)]


def test_who_has_the_slot_and_what_to_type(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", "msbot.part")

    async def scene(stage: Stage) -> None:
        stage.plug("AA", "ABCD")
        await asyncio.sleep(WAIT_S)
        spare = stage.plug("my spare", "ABCD")
        await asyncio.sleep(3 * WAIT_S)
        assert spare.state.value == "refused"
        assert heard(caplog) == [
            "slot AA has AA; this part gets a slot when one is free, or by `msbot swap AA --to 'my spare'`"
        ], "said once"
        assert stage.parts["AA"].state is JoinState.ACTIVE
        await stage.do.swap("AA", "my spare", who="ann")
        await asyncio.sleep(WAIT_S)
        assert spare.state is JoinState.ACTIVE, "the command is right"
        assert heard(caplog)[1:] == [
            "slot AA has my spare; this part gets a slot when one is free, or by `msbot swap AA --to AA`"
        ], "now the other one is told"

    play(tmp_path, scene)


def test_what_a_part_is_told_without_a_slot_when_it_is_blocked_and_when_it_shows_a_uid_twice(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "msbot.part")

    async def scene(stage: Stage) -> None:
        stage.plug("eye", "DIAL")
        await asyncio.sleep(WAIT_S)
        assert heard(caplog) == []
        stage.plug("fan", "FAN-5V")
        await asyncio.sleep(WAIT_S)
        assert heard(caplog) == ["this robot has no slot for a FAN-5V: `msbot slot add NAME FAN-5V` makes one"]
        await stage.do.add_slot("fan", "FAN-5V", who="ann")
        await asyncio.sleep(WAIT_S)
        assert stage.parts["fan"].state is JoinState.ACTIVE, "the command is right"
        await stage.do.block("fan", "loud", who="ann")
        await asyncio.sleep(WAIT_S)
        assert heard(caplog)[1:] == ["blocked: loud; `msbot unblock fan` lets it in again"]
        await stage.do.unblock("fan", who="ann")
        await asyncio.sleep(WAIT_S)
        assert stage.parts["fan"].state is JoinState.ACTIVE
        uid = int.from_bytes(stage.parts["fan"].uid or b"", "big")
        stage.plug("copy", "FAN-5V", uid=uid)
        await asyncio.sleep(2 * WAIT_S)
        assert heard(caplog)[2:] == ["fan in slot fan has the same UID"]
        assert "inproc" not in "".join(heard(caplog)), "addresses are only for teachers"

    play(tmp_path, scene, AA_IS_A_DIAL)


def test_slots_that_are_free_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", "msbot.part")

    async def scene(stage: Stage) -> None:
        for slot in ("left", "right"):
            await stage.do.add_slot(slot, "FAN-5V", who="ann")
        stage.plug("mine", "FAN-5V")
        await asyncio.sleep(WAIT_S)
        assert heard(caplog) == [
            "2 free slots fit and local name 'mine' names none of them: a person must say: "
            "`msbot adopt mine --slot SLOT` puts it into one of right, left"
        ]

    play(tmp_path, scene)


def test_what_is_told_is_a_configuration_of_no_slot() -> None:
    """Parts that do not know these words take no configuration before they are let in."""
    octets = help_message("x" * 1000).encode()
    told = ConfigurationMessage.decode(octets)
    assert (told.version, told.slot, len(told.settings[0].value)) == (0, "", LONGEST)
    assert len(octets) not in (4, 8, 12, 16, 17), "the lengths of other replies"
    with pytest.raises(RemoteProtocolError):
        ConfigurationMessage.decode(octets[:-3])


def test_a_board_says_it_in_the_same_words() -> None:
    micro.forget()
    lines: list[tuple[str, str]] = []
    micro.load("errors").listen(lambda *line: lines.append(line))
    version, slot, bindings, settings = micro.load("configuring").read(help_message("slot AA has AA").encode())
    assert (version, slot, list(bindings), len(settings)) == (0, "", [], 1)
    assert lines == [("info", f"{TOLD}slot AA has AA")]

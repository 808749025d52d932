"""Names of accounts: none that the robot uses itself, and whoever gets the name of one who left inherits nothing."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

from msbot.operations.rights import Role
from msbot.pnp.pupils import TakeOverByTeacher
from msbot.registry import ProgramSource
from msbot.registry.edits.users import Person, keep
from msbot_web.access.accounts import Accounts
from msbot_web.access.users import MemoryUsers
from msbot_web.programs.programs import ProgramActions, RegistryProgramStore
from msbot_xrce.errors import ConfigError
from tests.operations.stage import AA_IS_A_DIAL, Stage, play
from tests.web.access.test_accounts import PlainHasher, user
from tests.web.rig import Rig, show

PASSWORD = "correct horse"
TAKEN = (
    "demo",
    "Demo",
    "DEMO",
    "ｄemo",
    "msbot",
    "msbot key",
    "robot",
    "Robot",
    "master",
    "guest of ada",
    "Guest  of ada",
    "somebody at the robot",
    "the bigger robot",
    "(demo)",
    "newcomer",
)


@pytest.mark.parametrize("name", TAKEN)
async def test_no_account_has_a_name_that_the_robot_signs_with(name: str) -> None:
    accounts = Accounts(MemoryUsers(user("ada")), clock=asyncio.get_running_loop().time, hasher=PlainHasher())
    with pytest.raises(ConfigError, match="uses for itself"):
        await accounts.add_user(name, Role.STUDENT, PASSWORD, who="ada")


def test_nor_by_any_other_way_into_the_database(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        for name in TAKEN:
            with pytest.raises(ConfigError, match="uses for itself"):
                stage.registry.edits.make(None, "x", partial(keep, people=[Person(name, "student")]))

    play(tmp_path, scene)


def test_an_account_named_demo_of_an_earlier_version_has_programs_of_its_own(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        clock = asyncio.get_running_loop().time
        accounts = Accounts(MemoryUsers(user("demo", Role.STUDENT)), clock=clock, hasher=PlainHasher())
        deeds = ProgramActions(RegistryProgramStore(stage.registry), accounts)
        administrator = accounts.enter(accounts.entry_token())
        pupil = accounts.sessions.begin("demo", Role.STUDENT)
        await deeds.store(administrator, "secret.py", ProgramSource("mine = 1"))
        assert await deeds.mine(pupil) == []
        assert [one.name for one in await deeds.mine(administrator)] == ["secret.py"]

    play(tmp_path, scene)


def test_whoever_gets_the_name_of_somebody_who_left_inherits_nothing(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        accounts, control = rig.accounts, rig.stage.operations.pupils
        await accounts.add_user("eve", Role.STUDENT, PASSWORD, who="ada")
        earlier = accounts.sessions.begin("eve", Role.STUDENT)
        token = await accounts.new_token("eve", "telephone", who="eve")
        ticket = rig.service.pupils.passes.make("eve", 1)
        guest, _ = accounts.guests.invite(earlier, "/program", 1)
        await rig.act(earlier, "set", slot="AA", name="period_s", value=0.5)
        await rig.act(rig.session(Role.TEACHER), "group", group="Red", pupils=["eve"], slots=["AA"])
        await rig.act(earlier, "hand")
        control._pupils.taken["eve"] = TakeOverByTeacher("teacher", 0.0)
        kept = accounts.sessions.to_persist(accounts.mark_of)
        await accounts.remove_user("eve", who="ada")
        await accounts.add_user("eve", Role.STUDENT, "another horse", who="ada")
        later = accounts.sessions.begin("eve", Role.STUDENT)
        assert not accounts.holds(earlier)
        assert accounts.by_api_token(token) is None
        assert control.group_of("eve") == ""
        assert control.held("eve") == ""
        assert control.hands == {}
        for use in (
            lambda: rig.service.pupils.passes.find(ticket),
            lambda: accounts.guests.admit(guest),
        ):
            with pytest.raises(Exception, match=r"not valid|used up"):
                use()
        (edit,) = [one for one in await rig.service.edits(10) if one.kind == "value"]
        assert not rig.service.may_undo(later, edit)
        with pytest.raises(Exception, match="may not arrange parts"):
            await rig.act(later, "undo", edit=edit.number)
        accounts.sessions.bring_back(kept, 1.0, accounts.role_of, accounts.mark_of)
        assert accounts.sessions.of("eve") == [later]

    show(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


def test_a_pupil_cannot_undo_into_the_slot_of_another_group(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        pupil = rig.session(Role.STUDENT)
        await rig.act(pupil, "set", slot="AA", name="period_s", value=0.5)
        (edit,) = [one for one in await rig.service.edits(10) if one.kind == "value"]
        await rig.act(rig.session(Role.TEACHER), "group", group="Red", pupils=["eve"], slots=["AA"])
        for number in (edit.number, None):
            with pytest.raises(ConfigError, match="slot AA belongs to group Red"):
                await rig.act(pupil, "undo", edit=number)

    show(tmp_path, scene, AA_IS_A_DIAL, parts=("AA=DIAL",))


async def test_an_account_that_was_made_anew_elsewhere_is_another_person() -> None:
    accounts = Accounts(MemoryUsers(), clock=asyncio.get_running_loop().time, hasher=PlainHasher())
    first = replace(user("eve", Role.STUDENT), since_ns=10**18)
    gone: list[str] = []
    accounts.on_gone(gone.append)
    accounts.load([first])
    session = accounts.sessions.begin("eve", Role.STUDENT)
    accounts.load([replace(first, since_ns=10**18 + 61 * 10**9)])
    assert gone == ["eve"]
    assert not accounts.holds(session)

"""A slot of a running robot is simulated with one word, and given back."""

from __future__ import annotations

import asyncio
from pathlib import Path

from msbot.part.join.pnp_messages import Nature
from tests.operations.stage import Stage, play

KNOB = ('[[slot]]\nname = "AA"', '[[slot]]\nname = "lamp"\npart = "LED"\n\n[[slot]]\nname = "AA"')


def holder(stage: Stage) -> tuple[str, Nature, bytes]:
    info = stage.master.inventory.holder("lamp", asyncio.get_running_loop().time())
    assert info is not None
    return info.state.value, info.nature, info.uid


def test_a_simulated_part_stands_in_for_a_real_one_which_gets_its_slot_back(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        real = holder(stage)[2]
        done = await stage.do.simulate("lamp", end=False, who="ann")
        assert done.words == "slot lamp is simulated: `msbot simulate lamp --end` ends it"
        await asyncio.sleep(1.0)
        state, nature, uid = holder(stage)
        assert (state, nature) == ("active", Nature.SIMULATED)
        assert uid != real
        stand_ins = stage.operations.stand_ins
        unit = stand_ins.simulated("lamp")
        assert unit is not None
        assert unit.readings()["shines"] is False
        assert unit.part.settings["brightness"] == "100"
        assert "is simulated already" in await stage.refusal(stage.do.simulate("lamp", end=False, who="ann"))
        await stage.do.simulate("lamp", end=True, who="ann")
        await asyncio.sleep(1.0)
        assert holder(stage) == ("active", Nature.UNKNOWN, real)
        assert stand_ins.names == ()
        assert "lamp is not simulated here" in await stage.refusal(stage.do.simulate("lamp", end=True, who="ann"))

    play(tmp_path, scene, KNOB, parts=("lamp=LED", "AA=ABCD", "BB=EFGH", "CC=WXYZ"))


def test_an_empty_slot_is_simulated_too_and_the_plug_can_be_pulled(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.simulate("lamp", end=False, who="ann")
        await asyncio.sleep(0.5)
        assert holder(stage)[:2] == ("active", Nature.SIMULATED)
        stand_ins = stage.operations.stand_ins
        stand_ins.unplug("lamp")
        await asyncio.sleep(0.1)
        assert holder(stage)[:2] == ("active", Nature.SIMULATED), "nothing but missing beats tells of it"
        await asyncio.sleep(3.0)
        assert holder(stage)[0] == "late"
        await asyncio.sleep(7.0)
        now = asyncio.get_running_loop().time()
        assert stage.master.inventory.holder("lamp", now) is None
        stand_ins.plug("lamp")
        await asyncio.sleep(2.0)
        assert holder(stage)[:2] == ("active", Nature.SIMULATED)
        done = await stage.do.simulate("lamp", end=True, who="ann")
        assert done.words == "slot lamp is not simulated any more: plug its part in"
        await asyncio.sleep(0.5)
        assert stage.master.inventory.holder("lamp", asyncio.get_running_loop().time()) is None

    play(tmp_path, scene, KNOB, parts=("AA=ABCD", "BB=EFGH", "CC=WXYZ"))


def test_a_stand_in_is_not_trusted_like_the_robots_own_services(tmp_path: Path) -> None:
    async def scene(stage: Stage) -> None:
        await stage.do.simulate("lamp", end=False, who="ann")
        names = [link.info.name for link in stage.master.links]
        assert names == ["wire", "simulated here"]

    play(tmp_path, scene, KNOB, parts=("AA=ABCD", "BB=EFGH", "CC=WXYZ"))

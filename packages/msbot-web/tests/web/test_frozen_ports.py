"""What cards and API say of a port whose partner's program is frozen, without a browser."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from msbot.pnp import Freeze
from tests.web.rig import Rig, belongs_to, show


@pytest.mark.parametrize("is_given_up", [False, True], ids=["in its slot", "its slot is given up"])
def test_a_port_whose_partner_is_frozen_says_that_it_is_lost(is_given_up: bool, tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        await rig.look(3.0)
        inventory, now = rig.stage.master.inventory, asyncio.get_running_loop().time
        belongs_to(rig, "AA", "Ben")

        def held() -> str:
            return next(port.held for port in rig.views.slot("BB").ports if port.port == "in")

        assert held() == ""
        inventory.pupil_parts.pupils.freeze = Freeze("Ada", "", now())
        inventory.pupil_parts.follow(now())
        await rig.look(0.2)
        assert held() == "partner lost"
        if is_given_up:
            await rig.stage.operations.do("release", who="Ada", slot="AA")
            for _ in range(30):  # in no moment of it
                await asyncio.sleep(0.1)
                rig.views.poll()
                assert held() == "partner lost"
            return
        inventory.pupil_parts.pupils.freeze = None
        inventory.pupil_parts.follow(now())
        await rig.look(2.0)
        assert held() == ""

    show(tmp_path, scene)

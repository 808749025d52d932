"""The page Missions, without a browser: which missions this robot can have is seen before one is started."""

from __future__ import annotations

from pathlib import Path

from nicegui import Client, ui
from nicegui.page import page as nicegui_page

from msbot.operations.rights import Role
from msbot_school.faults.fault_lab import FaultLab
from msbot_school.missions.mission_file import ready_missions
from msbot_school.missions.mission_lab import MissionLab
from msbot_web.language import languages
from msbot_web.pages.missions import _Missions
from msbot_web.pages.page import Page
from tests.web.rig import Rig, show


def test_missions_of_another_robot_are_marked_and_say_how_to_get_it(tmp_path: Path) -> None:
    async def scene(rig: Rig) -> None:
        await rig.look(0.1)
        operations = rig.stage.operations
        MissionLab(operations, FaultLab(operations))
        others = operations.missions.obstacles()
        assert "one-silent" in others
        assert "chatterbox" in others
        with Client(nicegui_page("/")) as client:
            page = Page(rig.service, rig.session(Role.TEACHER), languages()["en"])
            _Missions(page)._show()
            (chosen,) = [one for one in client.elements.values() if isinstance(one, ui.select)]
            (start,) = [one for one in client.elements.values() if isinstance(one, ui.button) and one.text == "Start"]
            assert isinstance(chosen.options, dict)
            marked = {name for name, title in chosen.options.items() if "needs another robot" in title}
            assert marked == set(others)
            assert set(chosen.options) == set(ready_missions())
            chosen.set_value("one-silent")
            assert not start.enabled
            said = [one.text for one in client.elements.values() if isinstance(one, ui.label) and one.visible]
            assert any(words.endswith(": `msbot demo --robot rover` has them.") for words in said)

    show(tmp_path, scene, parts=())

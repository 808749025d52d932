"""The doctor of the page: one examination for everybody who looks at the same time, and backups."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from msbot.config import SAMPLE_ROBOT_TOML, load_library, parse_blueprint
from msbot.doctor import Examination, Examined
from msbot.registry import open_registry
from msbot_web.doctor_service import KEPT_S, DoctorService
from msbot_xrce.errors import RegistryError

NOTHING = Examination((), (), (), ())


async def test_one_examination_serves_all_who_look_for_some_seconds() -> None:
    looks: list[Examined] = []
    clock = 100.0

    def look(patient: Examined) -> Examination:
        looks.append(patient)
        return NOTHING

    doctor = DoctorService(lambda: Examined(None), lambda: clock, look)
    assert await asyncio.gather(*(doctor.examine() for _ in range(5))) == [NOTHING] * 5
    assert len(looks) == 1
    await doctor.examine(anew=True)
    assert len(looks) == 2, "asked for"
    clock += KEPT_S
    await doctor.examine()
    assert len(looks) == 3, "too old"


async def test_the_backup_that_the_page_writes_is_where_the_doctor_looks_for_it(tmp_path: Path) -> None:
    path, library = tmp_path / "rover.db", load_library()
    with open_registry(path) as registry:
        registry.robots.apply_blueprint(parse_blueprint(SAMPLE_ROBOT_TOML, library=library), library)
    patient = Examined(str(path))
    words = await DoctorService(lambda: patient, lambda: 0.0).back_up()
    (written,) = (tmp_path / "backups").glob("rover-*.db")
    assert words == f"{written} is written"
    with open_registry(written, read_only=True) as registry:
        assert [robot.name for robot in registry.robots.all()] == ["MSBOT_MASTER"]


async def test_a_robot_without_a_database_file_has_nothing_to_back_up() -> None:
    with pytest.raises(RegistryError, match="nothing to back up"):
        await DoctorService(lambda: Examined("postgresql://server/robot"), lambda: 0.0).back_up()

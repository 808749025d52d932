"""Pupils hand in what they have of a lesson; teachers open, comment and return it; nobody sees another pupil's."""

from __future__ import annotations

import asyncio
from pathlib import Path

from msbot.operations.rights import Role
from msbot.registry import ProgramSource
from msbot_web.access.accounts import Accounts
from msbot_web.access.sessions import Session
from msbot_web.access.users import MemoryUsers
from msbot_web.hand_ins import MOST_NOTE, HandInActions
from msbot_web.lessons_view import LessonsView
from msbot_web.programs.programs import ProgramActions, RegistryProgramStore
from tests.lessons.lesson_stage import LessonStage, lesson_scene
from tests.web.access.test_accounts import PlainHasher, user
from tests.web.rig import PASSWORD, refusal

NOW_NS = 5_000_000_000_000


class Desk:
    """What handing in needs of the page, on the robot of a lesson."""

    def __init__(self, stage: LessonStage) -> None:
        clock = asyncio.get_running_loop().time
        people = {"Ada": Role.STUDENT, "Ben": Role.STUDENT, "Ms Novak": Role.TEACHER, "Eve": Role.VIEWER}
        users = MemoryUsers(*(user(name, role, PASSWORD) for name, role in people.items()))
        self.accounts = Accounts(users, clock=clock, hasher=PlainHasher())
        self.sessions = {name: self.accounts.sessions.begin(name, role) for name, role in people.items()}
        self.learning = LessonsView(stage.desk, stage.registry, self.accounts)
        programs = ProgramActions(RegistryProgramStore(stage.registry), self.accounts)
        self.work = HandInActions(
            self.accounts, programs, self.learning, stage.operations.lessons, epoch_ns=lambda: NOW_NS
        )

    def of(self, name: str) -> Session:
        return self.sessions[name]


def test_handed_in_opened_commented_and_returned(tmp_path: Path) -> None:
    async def scene(stage: LessonStage) -> None:
        desk = Desk(stage)
        work, ada, ben, novak, eve = desk.work, *(desk.of(name) for name in ("Ada", "Ben", "Ms Novak", "Eve"))
        assert "Take part first" in str(await refusal(lambda: work.hand_in(ada, "", "")))
        await stage.do("start_lesson", "Ms Novak", lesson="first_part")
        for name in ("Ada", "Ben"):
            await stage.do("join_lesson", name)
        await asyncio.sleep(8)
        await stage.refused("answer_lesson", "Ben", check="1.2", answer="nine")
        await stage.do("answer_lesson", "Ada", check="1.2", answer="ten slots")
        stage.registry.programs.store("Ada", "lamp.py", ProgramSource("print(1)\n"))
        stage.registry.programs.store("Ben", "mine.py", ProgramSource("print(2)\n"))
        number = await work.hand_in(ada, "lamp.py", "ready")
        assert "no program 'mine.py'" in str(await refusal(lambda: work.hand_in(ada, "mine.py", "")))
        assert "at most" in str(await refusal(lambda: work.hand_in(ada, "", "x" * (MOST_NOTE + 1))))
        await work.hand_in(ben, "", "")
        opened = await work.opened(novak, number)
        assert (opened.text, opened.answers, opened.note) == ("print(1)\n", {"1.2": "ten slots"}, "ready")
        assert NOW_NS - opened.from_ns >= 8e9, "the recording begins when she did"
        assert desk.learning.is_right("first_part", "1.2", "ten slots")
        assert not desk.learning.is_right("first_part", "1.2", "nine")
        assert {one.person for one in await work.listed(novak)} == {"Ada", "Ben"}
        assert [one.person for one in await work.listed(ben)] == ["Ben"]
        assert await work.listed(eve) == []
        for session in (ben, eve):  # as if it were not there
            assert str(await refusal(lambda session=session: work.opened(session, number))) == str(  # type: ignore[misc]
                await refusal(lambda session=session: work.opened(session, 999))  # type: ignore[misc]
            ).replace("999", str(number))
            assert await refusal(lambda session=session: work.give_back(session, number, "ha"))  # type: ignore[misc]
        assert await refusal(lambda: work.hand_in(eve, "", ""))
        guest = desk.accounts.sessions.begin("Ada", Role.VIEWER, guest_of="Ms Novak")  # who calls themselves Ada
        assert await work.listed(guest) == []
        assert "number" in str(await refusal(lambda: work.opened(guest, number)))
        await work.give_back(novak, number, "good")
        assert (await work.opened(ada, number)).comment == "good"
        assert [(one.returned_by, one.comment) for one in await work.listed(ada)] == [("Ms Novak", "good")]

    lesson_scene(tmp_path, scene)


def test_a_program_that_changes_afterwards_stays_as_it_was_handed_in(tmp_path: Path) -> None:
    async def scene(stage: LessonStage) -> None:
        desk = Desk(stage)
        await stage.do("start_lesson", "Ms Novak", lesson="first_part")
        await stage.do("join_lesson", "Ada")
        stage.registry.programs.store("Ada", "lamp.py", ProgramSource("print(1)\n"))
        number = await desk.work.hand_in(desk.of("Ada"), "lamp.py", "")
        stage.registry.programs.store("Ada", "lamp.py", ProgramSource("print(2)\n"))
        assert (await desk.work.opened(desk.of("Ms Novak"), number)).text == "print(1)\n"

    lesson_scene(tmp_path, scene)

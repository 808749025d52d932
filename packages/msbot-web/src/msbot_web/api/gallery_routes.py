"""Robots and worlds to choose from, and the change of a demo's robot."""

from __future__ import annotations

from fastapi import APIRouter
from pydantic import Field

from msbot_school.demo.gallery import DemoChoice
from msbot_web.api.dependencies import SignedIn
from msbot_web.models.robot_models import ChangeResult, Model
from msbot_web.models.sentence_field import SentenceField
from msbot_web.service import Service


class GalleryLine(Model):
    """One robot, in a world or in none."""

    robot: str
    world: str
    """Empty: it is in none."""
    title: SentenceField
    teaches: SentenceField
    age: int
    """From which age on; 0: not said."""
    minutes: int
    """How long its task takes; 0: not said."""
    example: str
    """The program that does the task of the world; empty: there is none."""
    command: str
    """What starts it where there is no demo."""


class GalleryState(Model):
    """What there is, what runs, and what a change would end."""

    robot: str
    """The sample that runs; empty: this is no demo, its robot stays."""
    world: str
    entries: list[GalleryLine]
    ends: list[SentenceField]
    """What ends when the robot is changed."""


class ChangeRobotRequest(Model):
    """The robot that somebody wants in place of this one."""

    robot: str = Field(default="", max_length=64)
    """A sample; empty: that of the lesson."""
    world: str = Field(default="", max_length=64)
    lesson: str = Field(default="", max_length=64)
    """Begins there; empty: none."""
    agreed: bool = False
    """Whether what ends may end; without it the change is refused (409) when something would."""


def add_gallery(router: APIRouter, service: Service) -> None:
    """Add the calls."""
    gallery = service.gallery

    @router.get("/gallery")
    async def robots_and_worlds(session: SignedIn) -> GalleryState:  # noqa: ARG001
        """The robots and worlds to choose from, and what a change would end."""
        now = gallery.now or DemoChoice("")
        return GalleryState(
            robot=now.robot,
            world=now.world,
            entries=[
                GalleryLine(
                    robot=one.choice.robot,
                    world=one.choice.world,
                    title=one.title,
                    teaches=one.teaches,
                    age=one.age,
                    minutes=one.minutes,
                    example=one.example,
                    command=one.choice.command,
                )
                for one in gallery.entries
            ],
            ends=gallery.what_ends(),
        )

    @router.post("/gallery")
    async def change_robot(session: SignedIn, wish: ChangeRobotRequest) -> ChangeResult:
        """Have another robot in place of this one: only a demo can, and only teachers may."""
        choice = DemoChoice(wish.robot, wish.world) if wish.robot or not wish.lesson else gallery.choice_of(wish.lesson)
        return await gallery.change(session, choice, wish.lesson, agreed=wish.agreed)

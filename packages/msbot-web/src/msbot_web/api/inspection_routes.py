"""The calls that look at topics and at the log; see `msbot.operations.topic_inspection` and `robot_log`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

from fastapi import APIRouter, Query

from msbot_web.access.sessions import Session
from msbot_web.api.dependencies import Name, SignedIn, words_for
from msbot_web.models.topic_models import LogLineModel, LogLines, TopicInfo, TopicMessages
from msbot_web.service import Service
from msbot_xrce.errors import NotThere

After = Annotated[int | None, Query(ge=0, le=2**53, description="The number that the answer before gave as `next`.")]
Wait = Annotated[float, Query(ge=0.0, le=3.0, description="Seconds to wait for the next, if there is none yet.")]


def add_inspection(router: APIRouter, service: Service) -> None:
    """Add the calls for one robot."""

    @router.get("/topics/{topic}")
    async def topic(session: SignedIn, topic: Name) -> TopicInfo:
        """A topic: its type, who publishes and who subscribes, how many messages it has carried."""
        found = await _ask(service, session, "topics")
        for one in found["topics"]:
            if one["topic"] == topic:
                return TopicInfo.model_validate(one)
        known = ", ".join(one["topic"] for one in found["topics"]) or "it has none"
        raise NotThere(f"this robot has no topic {topic!r}; there are {known}")

    @router.get("/topics/{topic}/messages")
    async def messages(
        session: SignedIn,
        topic: Name,
        type: Annotated[str | None, Query(max_length=254, description="Of a free topic.")] = None,
        after: After = None,
        wait: Wait = 0.0,
    ) -> TopicMessages:
        """The messages of a topic after one of them; without `after` only the newest number."""
        found = await _ask(service, session, "topic_samples", topic=topic, type=type, after=after, wait=wait)
        return TopicMessages.model_validate(found)

    @router.get("/log")
    async def log(
        session: SignedIn,
        after: After = None,
        last: Annotated[int, Query(ge=0, le=200, description="Without `after`: how many of the last ones.")] = 10,
        wait: Wait = 0.0,
        slot: Annotated[str | None, Query(max_length=254, description="Only lines of this slot.")] = None,
    ) -> LogLines:
        """What happened in the robot after a line of its log; without `after` the last lines."""
        found = await _ask(service, session, "log_lines", after=after, last=last, wait=wait)
        told = [
            LogLineModel(**line | {name: words_for(session, line[name]) for name in ("who", "words")})
            for line in found["lines"]
            if slot in (None, line["slot"])
        ]
        return LogLines(next=found["next"], missed=found["missed"], lines=told)


async def _ask(service: Service, session: Session, question: str, **arguments: object) -> Mapping[str, Any]:
    given = {name: value for name, value in arguments.items() if value is not None}
    return (await service.operations.do(question, who=service.asker(session), **given)).answer

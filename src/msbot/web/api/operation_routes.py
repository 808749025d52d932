"""The calls that do something to the robot, made from the table of operations."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable, Callable
from functools import partial
from inspect import Parameter, Signature, signature
from typing import Annotated, Any

from fastapi import APIRouter, Header, Path
from pydantic import Field, create_model

from msbot.operations.operation import Argument, ArgumentKind, Operation
from msbot.operations.table import OPERATIONS
from msbot.web.api.answers import PROBLEMS
from msbot.web.api.models import Done, Model, Scalar
from msbot.web.api.session import SignedIn
from msbot.web.service import Service, done_of

_TYPES: dict[ArgumentKind, object] = {
    ArgumentKind.TEXT: str,
    ArgumentKind.TEXTS: list[str],
    ArgumentKind.NUMBER: float,
    ArgumentKind.WHOLE: int,
    ArgumentKind.FLAG: bool,
    ArgumentKind.VALUE: Scalar,
}


STOP = OPERATIONS["stop"]
PREFIX = "/api"
STOP_PATH = PREFIX + STOP.call.split()[1]


MOST_PRESSES = 64
"""Presses of STOP that are known again; a page says one again for as long as it is open and has no answer."""

LONGEST_PRESS = 64
"""Longest name of a press, in characters; a longer one is none."""


def make_stop_api(service: Service) -> APIRouter:
    """The call of STOP alone: it is there before all others, and never waits until they are.

    A page whose answer is late says its STOP again, under the same name of the press. What was heard already is not
    said once more: somebody may have said GO in between.
    """
    router = APIRouter(prefix=PREFIX, responses=PROBLEMS)
    path = STOP.call.split()[1]
    say = _call_of(STOP, path, service)
    heard: dict[tuple[str, str], asyncio.Task[Done]] = {}

    def ended(named: tuple[str, str], saying: asyncio.Task[Done]) -> None:
        """What was not said may be tried again; it is told to who waits, if somebody still does."""
        if saying.cancelled() or saying.exception() is not None:
            heard.pop(named, None)

    async def call(press: str | None, **given: Any) -> Done:  # noqa: ANN401 - as in `_call_of`
        if press is None or len(press) > LONGEST_PRESS:  # no name is a reason to refuse a STOP
            return await say(**given)
        named = (given["session"].name, press)
        if named not in heard:
            heard[named] = asyncio.ensure_future(say(**given))
            heard[named].add_done_callback(partial(ended, named))
            while len(heard) > MOST_PRESSES:
                del heard[next(iter(heard))]
        return await asyncio.shield(heard[named])

    header = Annotated[str | None, Header(alias="X-Stop-Press", include_in_schema=False)]
    parameters = [*signature(say).parameters.values(), _parameter("press", header, None)]
    call.__signature__ = Signature(parameters, return_annotation=Done)  # type: ignore[attr-defined]
    call.__doc__ = STOP.summary
    router.add_api_route(path, call, methods=["POST"], name=STOP.name, response_model=Done)
    return router


def add_operations(router: APIRouter, service: Service) -> None:
    """Add every other operation that has a call: names in the path, the other arguments in the body."""
    for operation in OPERATIONS.values():
        if operation.call and operation is not STOP:
            _add(router, service, operation)


def _add(router: APIRouter, service: Service, operation: Operation) -> None:
    method, path = operation.call.split()
    router.add_api_route(
        path, _call_of(operation, path, service), methods=[method], name=operation.name, response_model=Done
    )


def _call_of(operation: Operation, path: str, service: Service) -> Callable[..., Awaitable[Done]]:
    in_path = re.findall(r"{(\w+)}", path)
    in_body = [argument for argument in operation.arguments if argument.name not in in_path]

    async def call(**given: Any) -> Done:  # noqa: ANN401 - its signature is made below
        body: Model | None = given.pop("body", None)
        who = service.asker(given.pop("session"))
        named = {} if body is None else {argument.name: getattr(body, argument.passed_as) for argument in in_body}
        return done_of(await service.operations.do(operation.name, who=who, **given, **named))

    parameters = [_parameter("session", SignedIn)]
    for name in in_path:
        argument = operation.argument(name)
        assert argument is not None
        text = Annotated[str, Path(max_length=argument.longest, description=argument.help)]
        parameters.append(_parameter(name, text))
    if in_body:
        is_optional = not any(argument.is_needed for argument in in_body)
        model = _body(operation.name, in_body)
        parameters.append(_parameter("body", model | None, None) if is_optional else _parameter("body", model))
    call.__signature__ = Signature(parameters, return_annotation=Done)  # type: ignore[attr-defined]
    call.__doc__ = operation.summary
    return call


def _parameter(name: str, annotation: object, default: object = Parameter.empty) -> Parameter:
    return Parameter(name, Parameter.KEYWORD_ONLY, annotation=annotation, default=default)


def _body(name: str, arguments: list[Argument]) -> type[Model]:
    """The body of a call: one field for each argument, with the bounds of the table."""
    fields: dict[str, Any] = {argument.passed_as: _field(argument) for argument in arguments}
    return create_model(f"{name.title().replace('_', '')}Body", __base__=Model, **fields)


def _field(argument: Argument) -> tuple[object, object]:
    kind: Any = _TYPES[argument.kind]
    longest = argument.longest if argument.kind is ArgumentKind.TEXT else None
    known: dict[str, Any] = {
        "alias": argument.name, "description": argument.help,
        "max_length": longest, "ge": argument.least, "le": argument.most,
    }  # fmt: skip
    given = {name: value for name, value in known.items() if value is not None}
    if argument.is_needed:
        return kind, Field(**given)
    if argument.default is None:
        return kind | None, Field(default=None, **given)
    return kind, Field(default=argument.default, **given)

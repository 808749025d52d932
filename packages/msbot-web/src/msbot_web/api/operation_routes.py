"""The calls that do something to the robot, made from the table of operations."""

from __future__ import annotations

import re
from collections.abc import Awaitable, Callable, Iterator
from inspect import Parameter, Signature
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path
from pydantic import Field, create_model

from msbot.operations.operation import Argument, ArgumentKind, Operation
from msbot.operations.table import OPERATIONS
from msbot_agent.startup.extensions import extensions
from msbot_web.api.dependencies import SignedIn, done_for, session_of
from msbot_web.api.stop_route import STOP
from msbot_web.models.common_models import PROBLEMS
from msbot_web.models.robot_models import ChangeResult, Model, Scalar
from msbot_web.service import Service, done_of

_TYPES: dict[ArgumentKind, object] = {
    ArgumentKind.TEXT: str,
    ArgumentKind.TEXTS: list[str],
    ArgumentKind.NUMBER: float,
    ArgumentKind.WHOLE: int,
    ArgumentKind.FLAG: bool,
    ArgumentKind.VALUE: Scalar,
}


PREFIX = "/api"


def add_operations(router: APIRouter, service: Service) -> None:
    """Add every other operation that has a call: names in the path, the other arguments in the body."""
    for operation in OPERATIONS.values():
        if operation.call and operation is not STOP:  # `stop_route`
            _add(router, service, operation)


def _add(router: APIRouter, service: Service, operation: Operation) -> None:
    method, path = operation.call.split()
    router.add_api_route(
        path, _call_of(operation, path, service), methods=[method], name=operation.name, response_model=ChangeResult
    )


def _call_of(operation: Operation, path: str, service: Service) -> Callable[..., Awaitable[ChangeResult]]:
    in_path = re.findall(r"{(\w+)}", path)
    in_body = [argument for argument in operation.arguments if argument.name not in in_path]

    async def call(**given: Any) -> ChangeResult:  # noqa: ANN401 - its signature is made below
        body: Model | None = given.pop("body", None)
        session = given.pop("session")
        who = service.asker(session)
        named = {} if body is None else {argument.name: getattr(body, argument.passed_as) for argument in in_body}
        return done_for(session, done_of(await service.operations.do(operation.name, who=who, **given, **named)))

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
    call.__signature__ = Signature(parameters, return_annotation=ChangeResult)  # type: ignore[attr-defined]
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
        "alias": argument.name,
        "description": argument.help,
        "max_length": longest,
        "ge": argument.least,
        "le": argument.most,
    }
    given = {name: value for name, value in known.items() if value is not None}
    if argument.is_needed:
        return kind, Field(**given)
    if argument.default is None:
        return kind | None, Field(default=None, **given)
    return kind, Field(default=argument.default, **given)


# Calls of the API that extensions bring, below `/api/x/NAME`, for people who are signed in.


def brought_routers(service: Service) -> Iterator[APIRouter]:
    """The routers of all extensions; one whose function fails is left out."""
    for name, make in extensions().all("routes", object).items():
        router = APIRouter(prefix=f"{PREFIX}/x/{name}", responses=PROBLEMS, dependencies=[Depends(session_of)])
        try:
            router.include_router(make(service))  # type: ignore[operator]  # what cannot be called is left out
        except Exception as error:
            extensions().leave_out_named("routes", name, f"{type(error).__name__}: {error}")
            continue
        yield router

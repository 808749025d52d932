"""Services: what runs beside `msbot master` or `msbot agent`, with options of its own on their command lines.

A package names a `CommandService` by an entry point, for a master in the group `msbot.services`, for an agent in
`msbot.agent_services`. The command goes through all of them four times, in one order:

1. their `options` are added to its own, when its command line is read or its help is printed;
2. `check` reads what was given, before a database or link is opened, and says whether the service is wanted;
3. `preload` loads what takes long, while a master waits for its turn (`--standby`);
4. `coroutines`, in the event loop, makes the coroutines that run as long as the master or agent does.

Services that a service names in `after` come before it, so that it finds what these offer. A service of a stranger
that fails is left out, and the robot runs on; one of MsBOT's own ends the command as any mistake does.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Coroutine, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar, cast

import click

from msbot_agent.startup.extensions import Extension, Extensions, extensions
from msbot_xrce.errors import MsbotError
from msbot_xrce.lazy import dataclass

__all__ = ["CommandService", "ServedCommand", "WantedService", "wanted_services"]

T = TypeVar("T")
W = TypeVar("W")
"""What a service makes of its options."""
C = TypeVar("C")
"""What it gets to know of the master or agent."""
Beside = Coroutine[object, object, None]

_GIVEN = "msbot.given"


class CommandService(Generic[W, C]):
    """One kind of thing that can run beside a master or an agent; there is one object of it in a process."""

    options: Sequence[Callable[[Any], Any]] = ()
    """What `click.option(...)` returns, in the order of the help."""
    after: Sequence[str] = ()
    """The services, by the names of their entry points, that come before this one where they are installed."""

    def check(self, given: Mapping[str, Any]) -> W | None:
        """Read the command line.

        Args:
            given: the values of all options and arguments of the command.

        Returns:
            What is wanted, for the other methods; None: the service is not wanted, and is not called again.

        Raises:
            ConfigError: an option makes no sense; the text says what would be right.
        """
        raise NotImplementedError

    def preload(self, wanted: W) -> None:
        """Load what takes long to load; called where there is time for it, and perhaps not at all."""

    def coroutines(self, wanted: W, context: C) -> Iterable[Beside]:  # noqa: ARG002 - for those that need them
        """What runs beside the master or agent, until cancelled.

        Args:
            wanted: what `check` returned.
            context: a `msbot.cli.run.master_services.MasterContext`, or a
                `msbot_agent.cli.agent.agent_service.AgentContext`.

        Raises:
            ConfigError: it cannot run.
        """
        return ()


@dataclass(frozen=True, slots=True)
class WantedService:
    """A service with what the command line says of it."""

    service: CommandService[Any, Any]
    wanted: object
    extension: Extension
    left_out: Callable[[Extension, str], None]

    def preload(self) -> None:
        """See `CommandService.preload`."""
        self.attempt(partial(self.service.preload, self.wanted), None)

    def coroutines(self, context: object) -> list[Beside]:
        """See `CommandService.coroutines`."""
        found = self.attempt(lambda: list(self.service.coroutines(self.wanted, context)), list[Beside]())
        return found if self.extension.is_own else [self._run(one) for one in found]

    def attempt(self, action: Callable[[], T], otherwise: T) -> T:
        """Do something with it; where it fails and is a stranger's, leave it out."""
        try:
            return action()
        except MsbotError:
            raise
        except Exception as error:
            if self.extension.is_own:
                raise
            self.left_out(self.extension, _words(error))
            return otherwise

    async def _run(self, work: Beside) -> None:
        try:
            await work
        except Exception as error:  # a robot does not end because of a stranger's service
            self.left_out(self.extension, _words(error))


class ServedCommand(click.Command):
    """A command with the options of services, which its function does not get; see `wanted_services`.

    They are looked for when its options are, not when its module is imported.
    """

    group: ClassVar[str]
    """The group of their entry points."""
    find: Callable[[], Extensions] = staticmethod(extensions)
    _has_all: bool
    """Whether the options of the services are among its own already."""

    @cached_property
    def services(self) -> dict[str, tuple[Extension, CommandService[Any, Any], list[click.Parameter]]]:
        """Those that are installed, in their order, by name."""
        brought = self.find()
        loaded = brought.all(self.group, CommandService)
        about = brought.names(self.group)
        taken = {name for one in self._params for name in (one.name, *one.opts, *one.secondary_opts)}
        found = {}
        for name in _in_order(loaded, about):
            try:
                params = _parameters(loaded[name])
            except Exception as error:
                brought.leave_out(about[name], _words(error))
                continue
            names = {word for one in params for word in (one.name, *one.opts, *one.secondary_opts)}
            if names & taken:
                twice = ", ".join(sorted(word for word in names & taken if word and word.startswith("-")))
                brought.leave_out(about[name], f"the command has {twice or 'an option of that name'} already")
                continue
            taken |= names
            found[name] = (about[name], loaded[name], params)
        return found

    @property
    def params(self) -> list[click.Parameter]:
        """Its own options and arguments, and those of its services."""
        if not self._has_all:
            self._has_all = True
            self._params += [one for _, _, params in self.services.values() for one in params]
        return self._params  # this list itself, which click appends to and takes from

    @params.setter
    def params(self, params: list[click.Parameter]) -> None:
        self._params, self._has_all = params, False

    def invoke(self, ctx: click.Context) -> object:
        """Call its function with its own options."""
        ctx.meta[_GIVEN] = dict(ctx.params)
        for _, _, params in self.services.values():
            for one in params:
                ctx.params.pop(one.name or "", None)
        return super().invoke(ctx)


def wanted_services() -> tuple[WantedService, ...]:
    """The services that the command line of the running command asks for, in their order.

    Raises:
        ConfigError: an option of one of them makes no sense.
    """
    context = click.get_current_context()
    command = cast("ServedCommand", context.command)
    given: Mapping[str, Any] = context.meta[_GIVEN]
    found = []
    for extension, service, _ in command.services.values():
        one = WantedService(service, None, extension, command.find().leave_out)
        wanted = one.attempt(partial(service.check, given), None)
        if wanted is not None:
            found.append(replace(one, wanted=wanted))
    return tuple(found)


def _parameters(service: CommandService[Any, Any]) -> list[click.Parameter]:
    def carrier() -> None:
        """Click leaves the options at a function."""

    for option in reversed(service.options):
        option(carrier)
    return cast("list[click.Parameter]", getattr(carrier, "__click_params__", []))[::-1]


def _in_order(services: Mapping[str, CommandService[Any, Any]], about: Mapping[str, Extension]) -> Iterator[str]:
    """Each after those that it names; of several the own ones first, then by name."""
    left = sorted(services, key=lambda name: (not about[name].is_own, name))
    while left:
        # Where they wait for each other in a circle, the first goes on.
        name = next((name for name in left if not {*services[name].after} & {*left} - {name}), left[0])
        left.remove(name)
        yield name


def _words(error: Exception) -> str:
    """What went wrong, and the line of code that raised it."""
    innermost = traceback.extract_tb(error.__traceback__)[-1:]
    places = "".join(f" ({Path(one.filename).name}:{one.lineno} in {one.name})" for one in innermost)
    return f"{type(error).__name__}: {error}{places}"

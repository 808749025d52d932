"""The examination: every check in turn; what one of them cannot see does not keep the others from looking."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from functools import partial
from typing import Any, Generic, TypeVar

from msbot.doctor.checks.bus_checks import check_can, check_i2c, check_serial
from msbot.doctor.checks.installation_checks import check_access, check_packages, check_python
from msbot.doctor.checks.machine_checks import check_clock, check_disk
from msbot.doctor.checks.network_checks import check_dds, check_firewall, check_multicast, check_ports, check_zenoh
from msbot.doctor.checks.robot_checks import check_robot
from msbot.doctor.checks.stop_checks import check_stop
from msbot.doctor.checks.storage_checks import check_database
from msbot.doctor.collectors import (
    bus_facts,
    installation_facts,
    machine_facts,
    network_facts,
    robot_facts,
    stop_facts,
    storage_facts,
)
from msbot.doctor.finding import CannotSee, Examined, Finding, NotNeeded, Unavailable
from msbot_agent.startup.extensions import extensions
from msbot_xrce.errors import ConfigError, MsbotError
from msbot_xrce.lazy import dataclass

F = TypeVar("F")


@dataclass(frozen=True, slots=True)
class Check(Generic[F]):
    """One thing to look at."""

    name: str
    gather: Callable[[Examined], F]
    """Gets the facts; raises CannotSee when they cannot be had."""
    judge: Callable[[F], Iterable[Finding | Unavailable]]
    """Pure: what is wrong about the facts."""

    def __call__(self, patient: Examined) -> list[Finding | Unavailable]:
        """Look and judge."""
        return list(self.judge(self.gather(patient)))


CHECKS: tuple[Check[Any], ...] = (
    Check("python", installation_facts.python, check_python),
    Check("packages", installation_facts.packages, check_packages),
    Check("permissions", installation_facts.access, check_access),
    Check("can", bus_facts.can, check_can),
    Check("serial", bus_facts.serial, check_serial),
    Check("i2c", bus_facts.i2c, check_i2c),
    Check("dds", network_facts.dds, check_dds),
    Check("zenoh", network_facts.zenoh, check_zenoh),
    Check("multicast", network_facts.multicast, check_multicast),
    Check("firewall", network_facts.firewall, check_firewall),
    Check("ports", network_facts.ports, check_ports),
    Check("database", storage_facts.database, check_database),
    Check("clock", machine_facts.clock, check_clock),
    Check("disk", machine_facts.disk, check_disk),
    Check("stop", stop_facts.stop, check_stop),
    Check("robot", robot_facts.robot, check_robot),
)
"""All checks, in the order in which a person would look: what is below first."""


@dataclass(frozen=True, slots=True)
class Examination:
    """What came of it."""

    findings: tuple[tuple[str, Finding], ...]
    """`(check, finding)`; what has to be mended comes before what is only noted."""
    not_seen: tuple[tuple[str, str], ...]
    """`(check, why)`: neither well nor ill."""
    not_needed: tuple[tuple[str, str], ...]
    """`(check, why)`: there is nothing here that the check could be about."""
    well: tuple[str, ...]
    """Checks that found nothing."""

    @property
    def is_well(self) -> bool:
        """Whether nothing has to be mended."""
        return not any(finding.must for _, finding in self.findings)

    def as_json(self) -> dict[str, object]:
        """The same for programs."""
        rows = ("problem", "about", "must", "saw", "why", "wire", "first", "mend")
        return {
            "well": self.is_well,
            "findings": [
                {"check": check, **{name: getattr(finding, name) for name in rows}} for check, finding in self.findings
            ],
            "not_looked_at": [{"check": check, "why": why} for check, why in self.not_seen],
            "not_needed": [{"check": check, "why": why} for check, why in self.not_needed],
            "in_order": list(self.well),
        }


def all_checks() -> Iterator[Check[Any]]:
    """MsBOT's own checks, then those of extensions."""
    yield from CHECKS
    names = [check.name for check in CHECKS]
    for name, check in extensions().all("checks", Check, names).items():
        yield Check(name, partial(_gathered, name, check.gather), partial(_judged, name, check.judge))


def _gathered(name: str, gather: Callable[[Examined], Any], patient: Examined) -> object:
    """The facts of an extension's check; what it raises is one thing that could not be seen."""
    try:
        return gather(patient)
    except (CannotSee, NotNeeded, MsbotError, OSError):
        raise
    except Exception as error:
        raise CannotSee(_failed(name, error)) from error


def _judged(
    name: str, judge: Callable[[Any], Iterable[Finding | Unavailable]], facts: object
) -> list[Finding | Unavailable]:
    """What it finds in them."""
    try:
        return list(judge(facts))
    except Exception as error:  # other people's code may raise anything
        return [Unavailable(_failed(name, error))]


def _failed(name: str, error: Exception) -> str:
    words = f"{type(error).__name__}: {error}"
    extensions().leave_out_named("checks", name, words)
    return f"the extension that brings this check failed: {words}"


def examine(patient: Examined, only: Collection[str] = (), checks: Iterable[Check[Any]] | None = None) -> Examination:
    """Look at everything, or at some of it.

    Args:
        patient: whom.
        only: names of checks; empty: all.
        checks: what there is to look at; None: `all_checks`.

    Raises:
        ConfigError: there is no check of such a name.
    """
    known = {check.name: check for check in (all_checks() if checks is None else checks)}
    for name in only:
        if name not in known:
            raise ConfigError(f"the doctor has no check {name!r}; there are {', '.join(known)}")
    findings: list[tuple[str, Finding]] = []
    not_seen: list[tuple[str, str]] = []
    not_needed: list[tuple[str, str]] = []
    well: list[str] = []
    for name, check in known.items():
        if only and name not in only:
            continue
        try:
            found = check(patient)
        except CannotSee as why:
            not_seen.append((name, why.why))
            continue
        except NotNeeded as why:
            not_needed.append((name, why.why))
            continue
        except (MsbotError, OSError) as error:
            not_seen.append((name, str(error)))
            continue
        findings += [(name, one) for one in found if isinstance(one, Finding)]
        not_seen += [(name, one.why) for one in found if isinstance(one, Unavailable)]
        if not found:
            well.append(name)
    findings.sort(key=lambda found: not found[1].must)  # notes last
    return Examination(tuple(findings), tuple(not_seen), tuple(not_needed), tuple(well))

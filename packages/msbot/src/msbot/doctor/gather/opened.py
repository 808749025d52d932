"""What several checks read of the robot's database."""

from __future__ import annotations

from msbot.doctor.finding import CannotSee
from msbot.doctor.patient import Patient
from msbot_agent.text.sentence import said


def database_of(patient: Patient) -> str:
    """The address of the database.

    Raises:
        CannotSee: there is none.
    """
    file = patient.database_file
    if patient.database is None or (file is not None and not file.exists()):
        raise CannotSee(said("there is no database yet: `msbot master` makes it, --db names another one"))
    return patient.database


def newest_record_s(patient: Patient) -> float | None:
    """The newest line of the journal, seconds since 1970; None: there is none."""
    try:
        address = database_of(patient)
    except CannotSee:
        return None
    from msbot.registry.maintenance.health import look_at_health

    newest_ns = look_at_health(address, thorough=False).newest_record_ns
    return None if newest_ns is None else newest_ns / 1e9

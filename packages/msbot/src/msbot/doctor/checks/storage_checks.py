"""The database."""

from __future__ import annotations

from collections.abc import Iterator

from msbot.doctor.facts import DatabaseFacts
from msbot.doctor.finding import Finding, Mending
from msbot_agent.text.sentence import said

OLD_BACKUP_S = 8 * 86400.0
"""A backup each day or each week is normal."""
LARGE_LOG_MB = 64.0
LARGE_MB = 1024.0
NO_TRACE = said("nothing: the robot goes on with what it has in memory")


def check_database(facts: DatabaseFacts) -> Iterator[Finding]:
    """Whether the database can be relied on."""
    name = facts.name
    if facts.unopened:
        yield Finding(
            "unopened",
            name,
            facts.unopened,
            said("a master cannot start with it, and this robot has no memory"),
            said("nothing: the master does not start"),
            f"msbot db check --db {name}",
            first=said("do what the sentence says; a file is put back from a backup by `msbot db restore`"),
        )
        return
    if facts.schema > facts.newest_schema:
        yield Finding(
            "schema-newer",
            name,
            said(
                "it was written by a newer MsBOT (schema {schema}, this one knows {newest})",
                schema=facts.schema,
                newest=facts.newest_schema,
            ),
            said("this MsBOT cannot use it"),
            said("nothing: the master does not start"),
            "msbot --version  # install the newer MsBOT that wrote it, from its folder or its wheels",
        )
        return
    if facts.schema < facts.newest_schema:
        yield Finding(
            "schema-older",
            name,
            said(
                "it has schema {schema}, and this MsBOT uses {newest}", schema=facts.schema, newest=facts.newest_schema
            ),
            said("commands that only look cannot read it; the next master brings it up to date"),
            NO_TRACE,
            f"msbot db migrate --db {name}",
        )
    for fault in facts.faults:
        yield Finding(
            "damage",
            name,
            fault,
            said("what is stored contradicts itself, and the robot may lose its memory"),
            said("parts get no slot or no settings after the next start"),
            f"msbot db restore BACKUP --db {name}",
            first=said("take the newest backup that `msbot db check` finds in order"),
        )
    if facts.is_locked:
        yield Finding(
            "locked",
            name,
            said("another program has locked it, and nobody can write"),
            said("changes wait in the master's memory, and are lost when it ends before the lock is given back"),
            NO_TRACE,
            f"fuser -v {name}",
            first=said("close the program that has it open, such as an SQLite browser"),
        )
    if facts.others_may_read:
        yield Finding(
            "readable-by-others",
            name,
            said("every user of this computer may read it"),
            said("it has the keys of parts and the password hashes of people"),
            NO_TRACE,
            f"chmod 600 {name}",
        )
    if facts.network_drive:
        yield Finding(
            "network-drive",
            name,
            said("it is on a network drive ({kind})", kind=facts.network_drive),
            said("SQLite's locks do not work there: it may be damaged when two programs use it"),
            NO_TRACE,
            f"msbot db backup ~/robot.db --db {name} && msbot master --db ~/robot.db",
        )
    if facts.log_mb > LARGE_LOG_MB:
        yield Finding(
            "log-grows",
            name,
            said("its log has {size:.0f} MB that are not taken over", size=facts.log_mb),
            said("a program reads without end and keeps SQLite from tidying up; the disk fills, and reading gets slow"),
            NO_TRACE,
            f"fuser -v {name}",
            first=said("close the program that has it open, such as an SQLite browser"),
        )
    if facts.size_mb > LARGE_MB:
        yield Finding(
            "database-large",
            name,
            said("it has {size:.0f} MB", size=facts.size_mb),
            said("copies take long; a robot's journal is bounded, so something else fills it"),
            NO_TRACE,
            f"msbot db check --db {name}",
            must=False,
        )
    yield from _backups(facts)


def _backups(facts: DatabaseFacts) -> Iterator[Finding]:
    if not facts.backups or facts.age_s < OLD_BACKUP_S:
        return
    if facts.backup_age_s is None:
        saw = said(
            "there is no backup in {folder}, and the robot is {days:.0f} days old",
            folder=facts.backups,
            days=facts.age_s / 86400,
        )
    elif facts.backup_age_s > OLD_BACKUP_S:
        saw = said(
            "the newest backup in {folder} is {days:.0f} days old",
            folder=facts.backups,
            days=facts.backup_age_s / 86400,
        )
    else:
        return
    yield Finding(
        "backup-old",
        facts.name,
        saw,
        said("when the disk or the card fails, names, slots, settings, wires and keys are gone"),
        NO_TRACE,
        f"msbot db backup {facts.backups} --keep 14 --db {facts.name}",
        mending=Mending("backup"),
        first=said("`msbot service install` makes one every day"),
    )

"""One spelling for each database, so that programs can tell whether they mean the same one."""

from __future__ import annotations

import os.path


def database_identity(db: str) -> str:
    """A unique spelling for each database: the full path of a file; a server's address without user and password."""
    scheme, separator, rest = db.partition("://")
    if not separator:
        return os.path.abspath(db)
    if scheme == "sqlite":
        return os.path.abspath(rest.removeprefix("/"))
    return f"{scheme.partition('+')[0]}://{rest.rpartition('@')[2]}"

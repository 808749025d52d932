"""A PostgreSQL server of our own: a fresh cluster in a folder of its own, reached by a Unix socket, never by TCP."""

import ctypes
import os
import pwd
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MISSING = "no PostgreSQL server on this machine: apt-get install postgresql"
NEEDED = "MSBOT_NEED_POSTGRES"
"""Set where tests must not be skipped for want of a server."""

# What was committed survives a crash of the server, not one of the computer.
_QUICK = ("fsync=off", "full_page_writes=off", "autovacuum=off")
_SMALL = ("shared_buffers=8MB", "max_connections=40", "listen_addresses=", "log_min_messages=fatal")
_START_S = 20.0
_PR_SET_PDEATHSIG = 1


def find_server() -> Path | None:
    """The folder with initdb and postgres; Debian keeps it out of the PATH."""
    for folder in sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True):
        if (folder / "postgres").exists() and (folder / "initdb").exists():
            return folder
    found = shutil.which("initdb")
    return None if found is None else Path(found).parent


@contextmanager
def running_server(programs: Path, *, network: str = "", host: str = "", durable: bool = False) -> Iterator[str]:
    """Serve; gives the beginning of an address, to which the name of a database is put in place of `{}`.

    With `network` (a namespace) and `host` (an address in it) the server is reached there by TCP, too. With `durable`
    it writes to the disk as servers do; tests do not need that.
    """
    user = _unprivileged()
    # Not below pytest's own folder: nobody else may enter that one.
    folder = Path(tempfile.mkdtemp(prefix="msbot-pg-", dir="/tmp"))
    try:
        if user is not None:
            os.chown(folder, user.pw_uid, user.pw_gid)
        data = folder / "data"
        arguments = ["--username=msbot", "--auth=trust", "--no-sync", "--encoding=UTF8", "--locale=C"]
        _run(user, [str(programs / "initdb"), f"--pgdata={data}", *arguments]).communicate()
        if host:
            (data / "pg_hba.conf").write_text("local all all trust\nhost all all samenet trust\n")
        with serving(programs, folder, network=network, host=host, durable=durable):
            yield f"postgresql://msbot@/{{}}?host={folder}"
    finally:
        shutil.rmtree(folder)


@contextmanager
def serving(
    programs: Path, folder: Path, *, network: str = "", host: str = "", durable: bool = False
) -> Iterator[None]:
    """The server of a cluster that is there: also once more, after it has crashed."""
    settings = [word for setting in (*_SMALL, *(() if durable else _QUICK)) for word in ("-c", setting)]
    user = _unprivileged()
    command = [str(programs / "postgres"), "-D", str(folder / "data"), "-k", str(folder), *settings]
    if network:
        assert user is not None, "only root has networks"
        as_user = ["setpriv", f"--reuid={user.pw_uid}", f"--regid={user.pw_gid}", "--clear-groups"]
        command = ["ip", "netns", "exec", network, *as_user, *command, "-c", f"listen_addresses={host}"]
        user = None
    server = _run(user, command)
    try:
        _wait_until_ready(server, programs, folder)
        yield
    finally:
        server.send_signal(signal.SIGINT)
        server.communicate(timeout=_START_S)


def _unprivileged() -> pwd.struct_passwd | None:
    """Who runs the server when we are root, which it refuses."""
    if os.geteuid() != 0:
        return None
    known = {entry.pw_name: entry for entry in pwd.getpwall()}
    return known.get("postgres") or known["nobody"]


def _run(user: pwd.struct_passwd | None, command: list[str]) -> "subprocess.Popen[bytes]":
    library = ctypes.CDLL(None)
    return subprocess.Popen(
        command,
        cwd="/",
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        user=None if user is None else user.pw_uid,
        group=None if user is None else user.pw_gid,
        extra_groups=None if user is None else [],
        # The server ends with the tests, even when they are killed.
        preexec_fn=lambda: library.prctl(_PR_SET_PDEATHSIG, signal.SIGINT),  # noqa: PLW1509 - there is one thread
    )


def _wait_until_ready(server: "subprocess.Popen[bytes]", programs: Path, folder: Path) -> None:
    until = time.monotonic() + _START_S
    ready = [str(programs / "pg_isready"), "-q", "-h", str(folder)]
    while subprocess.run(ready, check=False).returncode != 0:
        assert server.poll() is None, "the PostgreSQL server has ended at once"
        assert time.monotonic() < until, "the PostgreSQL server does not start"
        time.sleep(0.02)

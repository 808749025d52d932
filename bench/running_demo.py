"""A real `msbot demo` in a folder of its own, for benchmarks that look at its process and its page."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from bench.agent import sources_of

READY_S = 120.0


@contextlib.contextmanager
def running_demo(folder: Path, *words: str, python: str = sys.executable) -> Iterator[tuple[int, str]]:
    """A demo with these further words of its command, of this version; its process and the link that signs in."""
    log = folder / "log"
    command = [python, "-m", "msbot", "demo", "--port", "0", *words]
    home = {**os.environ, "HOME": str(folder), "XDG_RUNTIME_DIR": str(folder)}
    if python != sys.executable:
        home["PYTHONPATH"] = ":".join(sources_of(Path(__file__).resolve().parent.parent))
    folder.chmod(0o700)
    with log.open("w") as out:
        demo = subprocess.Popen(
            command, cwd=folder, env=home, stdin=subprocess.PIPE, stdout=out, stderr=subprocess.STDOUT
        )
    try:
        ends_at = time.monotonic() + READY_S
        while (link := re.search(r"http://\S+/enter\?token=\S+", log.read_text())) is None:
            if time.monotonic() > ends_at or demo.poll() is not None:
                raise SystemExit(f"the demo does not come up:\n{log.read_text()}")
            time.sleep(0.1)
        yield demo.pid, link[0]
    finally:
        demo.send_signal(signal.SIGTERM)
        demo.wait(30)

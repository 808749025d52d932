"""Modules of the machine's kernel: from the package that the emulated machine was prepared with."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path


def _cache() -> Path:
    """Where the machines are kept, as tools/run-in-vm.sh has it."""
    if own := os.environ.get("MSBOT_VM_CACHE"):
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "msbot-vm"


def load(name: str, *parameters: str) -> None:
    """Load a module, and before it those that it needs."""
    folder = _cache() / "linux/lib/modules" / os.uname().release
    lines = (folder / "modules.dep").read_text().splitlines()
    (line,) = [line for line in lines if line.partition(":")[0].endswith(f"/{name}.ko")]
    path, _, needed = line.partition(":")
    for one in reversed(needed.split()):
        _busybox("insmod", str(folder / one), check=False)  # perhaps it is there already
    _busybox("insmod", str(folder / path), *parameters, check=True)


def load_built(name: str) -> None:
    """Load the modules that this machine was given because Debian's kernel lacks them."""
    for path in (_cache() / name).glob("*.ko"):
        _busybox("insmod", str(path), check=False)  # perhaps it is there already


def unload(name: str) -> bool:
    """Try to unload a module; False: somebody uses it still."""
    return _busybox("rmmod", name.replace("-", "_"), check=False)


def _busybox(*words: str, check: bool) -> bool:
    command = [str(_cache() / "busybox/bin/busybox"), *words]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert not check or done.returncode == 0, done.stderr
    return done.returncode == 0

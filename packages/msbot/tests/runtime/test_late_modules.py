"""Modules that are loaded at their first use."""

import subprocess
import sys
from pathlib import Path

SCRIPT = """
import sys
from msbot.process.daemon_threads import load_lazily
load_lazily("late_one", "late_other", "nothing_of_that_name")
import late_one
print(loaded)
late_one.WORD
print(loaded)
try:
    import nothing_of_that_name
except ModuleNotFoundError as error:
    print(error.name)
import late_other
import late_other
print(loaded, late_other.WORD)
"""
MODULE = "import builtins\nbuiltins.loaded.append(__name__)\nWORD = 'here'\n"


def test_a_late_module_is_loaded_at_its_first_use_or_second_import(tmp_path: Path) -> None:
    for name in ("late_one", "late_other"):
        (tmp_path / f"{name}.py").write_text(MODULE)
    script = f"import builtins, sys\nbuiltins.loaded = []\nsys.path.append({str(tmp_path)!r})\n{SCRIPT}"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines() == [
        "[]",
        "['late_one']",
        "nothing_of_that_name",
        "['late_one', 'late_other'] here",
    ]

"""Importing the room without what it needs."""

import subprocess
import sys

import pytest

WITHOUT = """
import sys

sys.modules[{module!r}] = None
try:
    from msbot.registry import open_registry
except Exception as error:
    print(f"{{type(error).__name__}}: {{error}}")
"""


@pytest.mark.parametrize(
    ("module", "words"),
    [
        ("sqlalchemy", "RegistryError: the database needs SQLAlchemy and Alembic: pip install 'msbot[master]'"),
        ("msbot.pnp", "ModuleNotFoundError: import of msbot.pnp halted; None in sys.modules"),
    ],
)
def test_what_is_missing_is_named(module: str, words: str) -> None:
    command = [sys.executable, "-W", "error", "-c", WITHOUT.format(module=module)]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert (run.stdout.strip(), run.stderr) == (words, "")


def test_opening_a_database_that_is_up_to_date_does_not_import_alembic() -> None:
    script = "import sys, msbot.registry; print('alembic' in sys.modules)"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout == "False\n"

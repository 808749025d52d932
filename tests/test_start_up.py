"""The start-up budget: what is imported by `import msbot` and by `msbot --help` (time itself is measured in bench/)."""

import subprocess
import sys

import pytest

HEAVY = {"asyncio", "sqlalchemy", "alembic", "rich", "msgspec", "can", "serialx", "cyclonedds", "nicegui"}


def modules_after(code: str) -> set[str]:
    script = f"import sys\nbefore = set(sys.modules)\n{code}\nprint('\\n'.join(set(sys.modules) - before))"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return {name.partition(".")[0] for name in run.stdout.split()}


def test_import_msbot_needs_only_the_standard_library() -> None:
    foreign = modules_after("import msbot\nmsbot.Part, msbot.Message, msbot.run") - set(sys.stdlib_module_names)
    assert foreign == {"msbot"}


def test_help_imports_no_command() -> None:
    loaded = modules_after(
        "import msbot.cli, contextlib, io\n"
        "with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):\n"
        "    msbot.cli.msbot(['--help'])"
    )
    assert not loaded & HEAVY


@pytest.mark.parametrize("room", ["xrce", "link", "space", "agent", "part"])
def test_the_core_rooms_need_only_the_standard_library(room: str) -> None:
    assert modules_after(f"import msbot.{room}") - set(sys.stdlib_module_names) == {"msbot"}

"""The start-up budget: what is imported by `import msbot` and by `msbot --help` (time itself is measured in bench/)."""

import subprocess
import sys

import pytest

HEAVY = {"asyncio", "sqlalchemy", "alembic", "rich", "msgspec", "can", "serialx", "cyclonedds", "nicegui", "numpy"}
MOST_MODULES = 1520
"""What a robot with its page may load."""


def all_modules_after(code: str) -> set[str]:
    script = f"import sys\nbefore = set(sys.modules)\n{code}\nprint('\\n'.join(set(sys.modules) - before))"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    return set(run.stdout.split())


def modules_after(code: str) -> set[str]:
    return {name.partition(".")[0] for name in all_modules_after(code)}


def test_import_msbot_needs_only_the_standard_library() -> None:
    foreign = modules_after("import msbot\nmsbot.Part, msbot.Message, msbot.run") - set(sys.stdlib_module_names)
    assert foreign == {"msbot", "msbot_agent", "msbot_xrce"}


def test_help_imports_no_command_and_not_even_click() -> None:
    loaded = modules_after(
        "import msbot_agent.cli, contextlib, io\n"
        "sys.argv = ['msbot', '--help']\n"
        "with contextlib.redirect_stdout(io.StringIO()):\n"
        "    msbot_agent.cli.main()"
    )
    assert not loaded & (HEAVY | {"click"})


@pytest.mark.parametrize(
    ("room", "packages"),
    [
        ("msbot_xrce", {"msbot_xrce"}),
        ("msbot_agent.link", {"msbot_xrce", "msbot_agent"}),
        ("msbot_agent.space", {"msbot_xrce", "msbot_agent"}),
        ("msbot_agent.agent", {"msbot_xrce", "msbot_agent"}),
        ("msbot.part", {"msbot_xrce", "msbot_agent", "msbot"}),
    ],
)
def test_the_core_rooms_need_only_the_standard_library(room: str, packages: set[str]) -> None:
    assert modules_after(f"import {room}") - set(sys.stdlib_module_names) <= packages


def test_a_robot_with_its_page_waits_for_nothing_that_its_first_page_does_not_need() -> None:
    loaded = all_modules_after("import msbot_web.cli.demo.demo_command, msbot_web.assembly, msbot_web.demo_controls")
    # Names of parts of libraries: socket.io and uvicorn import the libraries themselves, which does no harm.
    foreign = {
        "aiohttp.client",
        "requests.api",
        "urllib3",
        "matplotlib",
        "plotly",
        "pandas",
        "polars",
        "numpy",
        "altair",
        "httpx",
        "markdown2",
        "docutils",
        "pygments.lexers",
        "alembic",
        "prometheus_client",
        "pydantic.v1.main",
        "rich.console",
        "segno",
        "websockets.server",
        "sqlalchemy.connectors.asyncio",
    }
    own = {
        "msbot_web.api.routes",
        "msbot_web.api.admin_routes",
        "msbot.doctor.examination",
        "msbot_agent.space.dds.dds_space",
        "msbot.ros2",
    }
    assert not loaded & (foreign | own)
    assert len(loaded) < MOST_MODULES


def test_the_models_of_an_api_description_are_built_when_somebody_asks_for_one() -> None:
    script = (
        "import msbot_web.assembly, fastapi\n"
        "from fastapi.openapi.models import OpenAPI\n"
        "was = OpenAPI.__pydantic_complete__\n"
        "text = fastapi.FastAPI().openapi()['openapi']\n"
        "from pydantic import BaseModel\n"
        "print(was, OpenAPI.__pydantic_complete__, text, 'defer_build' in BaseModel.model_config)"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["False", "True", "3.1.0", "False"]


def test_the_protocol_of_websockets_waits_for_the_first_of_them() -> None:
    loaded = all_modules_after(
        "import uvicorn, msbot_web.nicegui_internals.application\n"
        "uvicorn.Config(lambda: None, ws=msbot_web.nicegui_internals.application.LazyWebSocket).load()"
    )
    assert "uvicorn.protocols.http.httptools_impl" in loaded
    assert not {name for name in loaded if name.startswith("websockets")}


def test_a_look_at_a_robot_waits_for_no_large_library() -> None:
    loaded = modules_after("import msbot.cli.database_commands")
    assert not loaded & ((HEAVY | {"pydantic"}) - {"asyncio"})


@pytest.mark.parametrize("room", ["msbot_agent", "msbot_agent.agent", "msbot.doctor", "msbot.pnp", "msbot.registry"])
def test_a_lazy_room_has_all_names_that_it_shows(room: str) -> None:
    script = (
        f"import {room} as room; lazy = {{name for names in room._NAMES.values() for name in names}};"
        "missing = [name for name in room.__all__ if not hasattr(room, name)];"
        "print(sorted(lazy ^ set(room.__all__)), missing, hasattr(room, 'nothing'))"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[] [] False"

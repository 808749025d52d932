"""The container and its compose file: what runs may do no more than it has to."""

from __future__ import annotations

import os
import shlex
import subprocess
from pathlib import Path

import pytest
import yaml

FOLDER = Path(__file__).parent.parent / "packaging" / "container"
LINES = (FOLDER / "Containerfile").read_text("utf-8").splitlines()
SERVICES = yaml.safe_load((FOLDER / "compose.yaml").read_text("utf-8"))["services"]
BY_OTHERS = {"database"}
"""Images of others that write where they like: PostgreSQL's prepares its folders as root."""


def test_the_image_runs_as_a_user_and_knows_whether_it_is_well() -> None:
    users = [line.split()[1] for line in LINES if line.startswith("USER ")]
    assert users == ["msbot"]
    after = LINES[LINES.index("USER msbot") :]
    assert [line for line in after if line.startswith(("RUN ", "COPY ", "ADD "))] == []
    assert any(line.startswith("HEALTHCHECK ") and "/api/health" in line for line in after)


@pytest.mark.parametrize("name", sorted(SERVICES.keys() - BY_OTHERS))
def test_a_service_may_do_no_more_than_it_has_to(name: str) -> None:
    service = SERVICES[name]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert "no-new-privileges:true" in service["security_opt"]


def test_no_secret_stands_in_the_files() -> None:
    text = "".join(path.read_text("utf-8") for path in FOLDER.iterdir() if path.is_file())
    assert "POSTGRES_PASSWORD:" not in text
    assert SERVICES["database"]["environment"]["POSTGRES_PASSWORD_FILE"] == "/run/secrets/database"


@pytest.mark.promise("Other users of the computer read neither keys nor UIDs of parts")
def test_the_password_of_the_database_is_on_no_command_line(tmp_path: Path) -> None:
    """What runs in a container is in the computer's list of processes, which every user can read."""
    shell, option, script = SERVICES["robot"]["command"]
    program, secret = tmp_path / "msbot", tmp_path / "password"
    program.write_text('#!/bin/sh\necho "$PGPASSWORD" "$@"\n', "utf-8")
    program.chmod(0o755)
    script = script.replace("$$", "$").replace("/run/secrets/database", shlex.quote(str(secret)))
    environment = {"PATH": f"{tmp_path}:{os.environ['PATH']}"}

    def started() -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [shell, option, script], env=environment, capture_output=True, text=True, check=False, timeout=30
        )

    assert "No such file" in started().stderr, "without the file nothing is started"
    assert started().returncode != 0
    secret.write_text("a1b2c3\n", "utf-8")
    password, *arguments = started().stdout.split()
    assert password == "a1b2c3"
    assert "postgresql://msbot@database/msbot" in arguments
    assert "a1b2c3" not in " ".join(arguments)


def test_prometheus_asks_where_the_robot_serves_its_figures() -> None:
    (job,) = yaml.safe_load((FOLDER / "prometheus.yaml").read_text("utf-8"))["scrape_configs"]
    (target,) = job["static_configs"][0]["targets"]
    port = target.rpartition(":")[2]
    assert f"--metrics {port}" in " ".join(SERVICES["robot"]["command"])
    assert SERVICES["prometheus"]["network_mode"] == "service:robot"
    assert SERVICES["prometheus"]["depends_on"] == ["robot"]

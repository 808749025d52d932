"""The container and its compose file: what runs may do no more than it has to."""

from __future__ import annotations

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
    text = "".join(path.read_text("utf-8") for path in FOLDER.iterdir())
    assert "POSTGRES_PASSWORD:" not in text
    assert SERVICES["database"]["environment"]["POSTGRES_PASSWORD_FILE"] == "/run/secrets/database"


def test_prometheus_asks_where_the_robot_serves_its_figures() -> None:
    (job,) = yaml.safe_load((FOLDER / "prometheus.yaml").read_text("utf-8"))["scrape_configs"]
    (target,) = job["static_configs"][0]["targets"]
    port = target.rpartition(":")[2]
    assert f"--metrics {port}" in " ".join(SERVICES["robot"]["command"])
    assert SERVICES["prometheus"]["network_mode"] == "service:robot"
    assert SERVICES["prometheus"]["depends_on"] == ["robot"]

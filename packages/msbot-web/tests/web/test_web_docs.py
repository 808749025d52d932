"""What the documentation says about the page: the table of calls is complete, the examples run."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator

import httpx
import pytest

from tests import ROOT
from tests.e2e.processes import running
from tests.web.api.test_routes import Site

HOW_TO = (ROOT / "docs/howto/web_page.md").read_text()
REFERENCE = (ROOT / "docs/reference/web.md").read_text()
OPERATIONS = (ROOT / "docs/reference/operations.md").read_text()
EXAMPLE = ROOT / "examples/page/ask.py"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    folder = tmp_path_factory.mktemp("documented")
    with running("init", cwd=folder) as making:
        making.wait_for("robot.toml")
    with running("master", "--link", "udp:127.0.0.1:0", "--port", "0", cwd=folder) as process:
        site = Site(process, folder)
        yield site
        site.stranger.close()


def test_the_reference_lists_every_call_once_and_no_other(site: Site) -> None:
    """Those of operations in the table of operations."""
    schema = httpx.get(f"{site.base}/openapi.json", timeout=30).json()
    there = {f"{method.upper()} {path}" for path, calls in schema["paths"].items() for method in calls}
    listed = re.findall(r"^\* `([A-Z]+ /api/\S+)`: ", REFERENCE, re.MULTILINE)
    listed += re.findall(r"^\* `\w+`.* \(`([A-Z]+ /api/\S+)`, ", OPERATIONS, re.MULTILINE)
    assert sorted(listed) == sorted(there)


def environment(site: Site) -> dict[str, str]:
    return {**os.environ, "MSBOT_PAGE": site.base, "MSBOT_TOKEN": site.tokens["teacher"]}


def test_the_python_example_of_the_how_to_runs(site: Site) -> None:
    assert "`examples/page/ask.py`" in HOW_TO
    done = subprocess.run(
        [sys.executable, EXAMPLE], env=environment(site), capture_output=True, text=True, timeout=60, check=True
    )
    assert "AA: empty, nothing is plugged in" in done.stdout
    assert done.stdout.splitlines()[-1].startswith("STOP is over")


@pytest.mark.skipif(shutil.which("curl") is None, reason="no curl on this machine")
def test_the_calls_with_curl_run(site: Site) -> None:
    found = re.search(r"```sh\n(curl .*?)```", HOW_TO, re.DOTALL)
    assert found is not None
    script = found[1].replace("http://127.0.0.1:8080", site.base).replace("curl -s", "curl -sS --fail")
    done = subprocess.run(
        ["sh", "-ec", script], env=environment(site), capture_output=True, text=True, timeout=60, check=True
    )
    assert '"slots":' in done.stdout
    assert '"words":"STOP' in done.stdout
    assert site.ask("POST", "/api/go").status_code == 200

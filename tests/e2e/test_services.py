"""The two programs of "Ask another part and get its answer", in processes of their own.

They call over UDP, over a CAN bus, and with the part that serves behind a relay.
"""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests import ROOT
from tests.e2e.processes import PATIENCE_S, run, running
from tests.e2e.test_familiar_commands import lines
from tests.e2e.test_processes import free_port

PAGE = (ROOT / "docs/howto/services.md").read_text()
CAMERA, BRAIN = re.findall(r"```python\n(from msbot.*?)```", PAGE, re.DOTALL)
SERVES, BINDING, *_ = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
CALLS = SERVES.replace('"photo"', '"look"').replace('"serve"', '"call"')
ROBOT = f"""
library = ["library"]
[robot]
name = "LOOKER"
[[slot]]
name = "camera"
part = "CAM-1"
[[slot]]
name = "brain"
part = "BRAIN-1"
{BINDING}"""
HINTS = (
    (("service", "call", "camera.photo", "20"), "`msbot call SLOT.PORT VALUE...`"),
    (("call", "photo", "20"), "msbot call camera.photo VALUE..."),
    (("topic", "echo", "photo"), "photo is a service, and no topic: `msbot call camera.photo VALUE...` calls it"),
)
"""What people type out of habit, and what is said."""
ONCE = BRAIN.replace("        print(error)\n", "        print(error)\n    part.end()\n")
"""The same program; it ends after one call."""


@pytest.mark.promise("A call ends with its reply, or with one sentence, never without an end")
@pytest.mark.parametrize("way", ["udp", "sim", "relay"])
def test_the_programs_of_the_page_ask_and_answer(tmp_path: Path, way: str) -> None:
    assert ONCE != BRAIN
    (tmp_path / "robot.toml").write_text(ROBOT)
    (tmp_path / "library").mkdir()
    (tmp_path / "library/cam.toml").write_text(f'number = "CAM-1"\nname = "Camera"\n{SERVES}')
    (tmp_path / "library/brain.toml").write_text(f'number = "BRAIN-1"\nname = "Brain"\n{CALLS}')
    for name, text in (("camera", CAMERA), ("brain", ONCE), ("wide", ONCE.replace("degrees=45", "degrees=120"))):
        (tmp_path / f"{name}.py").write_text(text)
    link = ("--link", "sim:services" if way == "sim" else f"udp:127.0.0.1:{free_port()}")
    served = ("--link", f"udp:127.0.0.1:{free_port()}") if way == "relay" else link
    env = {"XDG_RUNTIME_DIR": str(tmp_path), "XDG_STATE_HOME": str(tmp_path / "state")}

    def asks(program: str) -> str:
        done = subprocess.run(
            [sys.executable, f"{program}.py", *link],
            cwd=tmp_path,
            env={**os.environ, **env},
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        return done.stdout

    with (
        contextlib.ExitStack() as between,
        running("master", "--no-page", *link, cwd=tmp_path, env=env) as master,
    ):
        master.wait_for("is up on")
        if way == "relay":
            between.enter_context(running("relay", served[1], link[1], cwd=tmp_path, env=env)).wait_for(
                "takes the parts"
            )
        with subprocess.Popen(
            [sys.executable, "camera.py", *served], cwd=tmp_path, env={**os.environ, **env}
        ) as camera:
            try:
                master.wait_for("CAM-1", "active in slot camera")
                assert asks("brain") == "a tree at 45 degrees\n"
                assert asks("wide") == "call of look: refused: the camera turns from 0 to 90 degrees only\n"
                called = run("call", "camera.photo", "degrees=20", cwd=tmp_path, env=env)
                assert (called.returncode, called.stdout) == (0, "camera.photo: a tree at 20 degrees\n")
                for line in (line for line in lines() if line[0] == "call"):
                    assert run(*line, cwd=tmp_path, env=env).stdout == called.stdout
                for words, hint in HINTS:
                    said = run(*words, cwd=tmp_path, env=env)
                    assert (said.returncode, hint in said.stderr) == (2, True), said.stderr
                assert "photo (service)" in run("topic", "list", cwd=tmp_path, env=env).stdout
            finally:
                camera.terminate()
        left = run("topic", "info", "photo", cwd=tmp_path, env=env)
        assert "camera.photo  (slot camera is empty)" in left.stdout
        refused = run("call", "camera.photo", "20", cwd=tmp_path, env=env)
        assert refused.returncode != 0
        assert len(refused.stderr.splitlines()) == 1

"""`msbot host` and the real side of `msbot part`, as far as no hardware is needed."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.e2e.processes import run

PARTS = """
[[part]]
type = "HC-SR04"
name = "front"
pins = { trigger = 5 }
[[part]]
type = "BUTTON"
simulate = true
"""


def msbot(folder: Path, *arguments: str) -> tuple[int, str]:
    done = run(*arguments, cwd=folder, env={"XDG_STATE_HOME": str(folder / "state")})
    return done.returncode, done.stdout + done.stderr


def test_a_file_can_be_read_without_touching_anything(tmp_path: Path) -> None:
    (tmp_path / "parts.toml").write_text(PARTS)
    status, said = msbot(tmp_path, "host", "--check")
    assert status == 0
    assert said.splitlines() == [
        "front: Ultrasonic range sensor (HC-SR04), trigger = GPIO 5, echo = GPIO 24",
        "BUTTON: Push button (BUTTON), simulated",
    ]
    status, said = msbot(tmp_path, "host", "--check", "--json")
    assert status == 0
    front, button = json.loads(said)
    assert front == {
        "name": "front",
        "part_number": "HC-SR04",
        "type": "Ultrasonic range sensor",
        "wiring": "trigger = GPIO 5, echo = GPIO 24",
    }
    assert button["wiring"] is None


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["host"], "parts.toml: there is no such file"),
        (["host", "--json"], "--json tells what --check finds: write `msbot host --check --json`"),
        (["part", "HC-SR04", "--pins", "trig=5"], 'has no wire to a GPIO pin "trig"; did you mean "trigger"?'),
        (["part", "BMP280", "--i2c", "1:0x10"], "a BMP280 cannot have the I2C address 0x10"),
        (["part", "WXYZ", "--real"], "part WXYZ has no driver for hardware"),
        (["part", "LED", "--real", "--set", "a=b"], "--set does something to a simulated thing"),
        (["part", "LED", "--simulate", "--pins", "s=17"], "a simulated part has no wires"),
        (["part", "NOBODY", "--simulate"], 'the library has no part number "NOBODY"'),
        (["part", "LED", "--option", "active_low=perhaps"], "option active_low of part LED is 'perhaps'"),
    ],
)
def test_a_mistake_is_one_sentence(arguments: list[str], sentence: str, tmp_path: Path) -> None:
    status, said = msbot(tmp_path, *arguments)
    assert status == 2
    assert sentence in said
    assert "Traceback" not in said


HIDE = """
import sys
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("gpiozero", "smbus2", "serialx", "lgpio"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Hidden())
from msbot.config import load_library
from msbot.hardware import HardwareFault, Machine, Mount, driver_class, make_wiring
for number in ("LED", "BMP280", "NUMATO-8"):
    part_type = load_library().require(number)
    driver = driver_class(part_type)(Mount(part_type, make_wiring(part_type), Machine(keeper=[])))
    try:
        driver.open()
    except HardwareFault as fault:
        print(fault)
    driver.close()
"""


def test_without_the_libraries_one_sentence_names_the_extra(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", HIDE], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    sentences = done.stdout.splitlines()
    assert len(sentences) == 3
    assert all("`pip install 'msbot[hardware]'` brings it" in sentence for sentence in sentences)

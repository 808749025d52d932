"""The card's helper, units and page in a machine with a systemd of its own: a set-up file, and updates that lead back.

The machine is User-Mode Linux with the processor of this computer and a clean Debian, into which the Debian package and
the files of the card are put; the card's data and its first partition are disks of their own (ext4 both). Image, kernel
and FAT of the card itself are tried by `make image-test`.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from tests.test_debian_package import clean_debian, inside, said_by_a_machine, unpack
from tools import debian_package, version
from tools.card_image.base import FILES
from tools.card_image.card import DATA
from tools.card_image.updates_trial import later_version

PASSWORD, WIFI_PASSWORD = "a compiler of 1952", "chalk and talk"
SET_UP = f"""name = "robot-7"
[administrator]
name = "grace"
password = "{PASSWORD}"
[wifi]
country = "DE"
network = "School"
password = "{WIFI_PASSWORD}"
[hardware]
can = "mcp2515-16mhz"
i2c = true
"""
UNITS = ("msbot-card.service", "msbot-card-serve.socket", "msbot-card-trial.service", "msbot-master.service")
TRIAL_S = 120
"""Of the broken update, in place of the card's own."""
MOUNTS = """/dev/ubdb /data ext4 noatime 0 0
/dev/ubdc /boot/firmware ext4 ro 0 0
/data/msbot /var/lib/msbot none bind 0 0
"""
SCRIPT = """#!/usr/bin/python3
import http.client, json, os, pathlib, socket, subprocess, sys, time, urllib.parse

sys.stdout = open("/dev/console", "w", buffering=1)
KEPT = pathlib.Path("/data/trial.json")
kept = json.loads(KEPT.read_text()) if KEPT.exists() else {"step": 0, "token": ""}


def call(method, path, body=None, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", 80, timeout=600)
    if kept["token"]:
        headers["authorization"] = "Bearer " + kept["token"]
    connection.request(method, path, body, headers)
    answer = connection.getresponse()
    return answer.status, answer.getheader("set-cookie"), answer.read()


def ask(method, path, body=None, **headers):
    content = body if body is None or isinstance(body, bytes) else json.dumps(body)
    status, _, read = call(method, path, content, **{"content-type": "application/json", **headers})
    assert status == 200, (method, path, status, read)
    return json.loads(read)


def until(what):
    while True:
        try:
            if found := what():
                return found
        except (OSError, http.client.HTTPException, AssertionError):
            pass
        time.sleep(1)


def told(word):
    versions = until(lambda: (now := ask("GET", "/api/card")["versions"])["told"] == word and now)
    programs = [name for name in ("first", "second") if call("GET", f"/api/programs/{name}.py")[0] == 200]
    print(f"{word}: {versions['current'] or 'that of the image'}, with {' and '.join(programs)}")


def restart(step):
    kept["step"] = step
    KEPT.write_text(json.dumps(kept))
    os.sync()
    ask("POST", "/api/card/restart")


def sign_in():
    body = urllib.parse.urlencode({"name": "grace", "password": PASS})
    status, cookie, _ = call("POST", "/login", body, **{"content-type": "application/x-www-form-urlencoded"})
    print("the administrator of the file:", status)
    shown = {"cookie": cookie.partition(";")[0]}
    shown["x-csrf-token"] = ask("GET", "/api/me", **shown)["csrf"]
    kept["token"] = ask("POST", "/api/users/grace/tokens", {"words": "trial"}, **shown)["token"]


until(lambda: call("GET", "/api/health")[0] == 200)
if kept["step"] == 0:
    print("name:", socket.gethostname(), pathlib.Path("/etc/hostname").read_text().strip())
    print("first partition:", *sorted(os.listdir("/boot/firmware")))
    print(*[line for line in pathlib.Path("/boot/firmware/config.txt").read_text().split() if "=msbot-" in line])
    network = pathlib.Path("/etc/wpa_supplicant/wpa_supplicant-wlan0.conf")
    print("Wi-Fi:", oct(network.stat().st_mode & 0o777), network.owner(), network.read_text().split()[0])
    sign_in()
    ask("PATCH", "/api/card", {"name": "robot-8"})
    print("name by the page:", socket.gethostname())
    ask("PUT", "/api/programs/first.py", {"text": "# of the image"})
    ask("POST", "/api/card/update", pathlib.Path("/good.deb").read_bytes())
    restart(1)
elif kept["step"] == 1:
    told("updated")
    ask("PUT", "/api/programs/second.py", {"text": "# of 9.0.0"})
    ask("POST", "/api/card/update", pathlib.Path("/broken.deb").read_bytes())
    restart(2)
elif kept["step"] == 2:
    told("fell back")
    ask("POST", "/api/card/back")
    restart(3)
else:
    told("went back")
    print("TRIAL-END")
    subprocess.run(["systemctl", "poweroff", "--force", "--force"])
"""


def disk(path: Path, size: int, content: Path) -> Path:
    """A file system of its own."""
    with path.open("wb") as file:
        file.truncate(size)
    subprocess.run(["mke2fs", "-q", "-t", "ext4", "-d", str(content), str(path)], check=True)
    return path


def put_card_files(root: Path, folder: Path) -> list[Path]:
    """Make the root that of a card; returns its two other disks."""
    for source in ("etc/systemd/system/msbot-master.service.d", "etc/sysctl.d", "usr/lib/msbot-card"):
        shutil.copytree(FILES / "root" / source, root / source, dirs_exist_ok=True)
    for unit in (FILES / "root/usr/lib/systemd/system").iterdir():
        shutil.copy(unit, root / "usr/lib/systemd/system")
    main = root / "usr/lib/msbot-card/msbot_card/__main__.py"
    text = main.read_text()
    assert "TRIAL_S, LOOK_S = 300.0, 3.0" in text
    main.write_text(text.replace("TRIAL_S, LOOK_S = 300.0", f"TRIAL_S, LOOK_S = {TRIAL_S}.0"))
    inside(root, "systemctl", "--quiet", "enable", *UNITS)
    (root / "etc/fstab").write_text(MOUNTS)
    for name in ("data", "boot/firmware", "etc/wpa_supplicant", "var/lib/msbot"):
        (root / name).mkdir(parents=True, exist_ok=True)
    data, boot = folder / "data", folder / "boot"
    for name in DATA:
        (data / name).mkdir(parents=True, mode=0o700)
    owner = int(inside(root, "id", "-u", "msbot")), int(inside(root, "id", "-g", "msbot"))
    shutil.chown(data / "msbot", *owner)
    shutil.copytree(FILES / "boot", boot)
    (boot / "msbot-setup.toml").write_text(SET_UP)
    return [disk(folder / "data.disk", 3 << 30, data), disk(folder / "boot.disk", 32 << 20, boot)]


@pytest.mark.slow
@pytest.mark.timeout(2700)
@pytest.mark.promise("A card takes its set-up file once, updates itself, returns from a broken update, and goes back")
def test_a_set_up_file_and_updates_that_lead_back(tmp_path: Path) -> None:
    root = tmp_path / "root"
    unpack(clean_debian(), root)
    package = debian_package.build(tmp_path, version.read())
    for name, later, broken in (("good", "9.0.0", False), ("broken", "9.9.9", True)):
        later_version(package, tmp_path, later, broken=broken).rename(root / f"{name}.deb")
    shutil.move(package, root / "0.deb")
    inside(root, "dpkg", "--force-unsafe-io", "--install", "/0.deb")
    (root / "0.deb").unlink()
    disks = put_card_files(root, tmp_path)
    said = said_by_a_machine(root, SCRIPT.replace("PASS}", f"{PASSWORD!r}}}"), tmp_path, disks, 2400)
    lines = [line.strip() for line in said.splitlines()]
    expected = [
        "name: robot-7 robot-7",
        "first partition: cmdline.txt config.txt lost+found msbot-setup.example.toml",
        "dtoverlay=msbot-i2c dtoverlay=msbot-i2c dtoverlay=msbot-i2c-pi5 dtoverlay=msbot-mcp2515,oscillator=16000000",
        "Wi-Fi: 0o600 root country=DE",
        "the administrator of the file: 303",
        "name by the page: robot-8",
        "updated: 9.0.0, with first",
        "fell back: 9.0.0, with first and second",
        "went back: that of the image, with first",
        "TRIAL-END",
    ]
    assert [line for line in expected if line not in lines] == [], said
    for path in disks:  # what was removed is not there any more, either
        content = path.read_bytes()
        assert PASSWORD.encode() not in content
        assert WIFI_PASSWORD.encode() not in content

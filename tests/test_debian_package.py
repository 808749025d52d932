"""The Debian package: its units, and what it does in a clean system.

The clean system is a root made by mmdebstrap, kept between runs; it takes root, mmdebstrap and a minute.
"""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from tools import debian_package, version
from tools.debian_package import CONFIGURED, FILES, unit
from tools.sources import ROOT

UNITS = sorted(path.name for path in (*FILES.glob("*.service"), *FILES.glob("*.timer")))
SUITE = "bookworm"
INCLUDED = "python3,systemd,systemd-sysv,udev,iproute2"
VERSIONS = (version.read(), f"{version.read()}+next1")
"""The package's, and that of the next one."""
NEEDED = bool(os.environ.get("MSBOT_NEED_DEB"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All unit files, as they are installed; programs are those of this computer."""
    folder = tmp_path_factory.mktemp("units")
    for name in UNITS:
        text = unit(name).replace("/usr/lib/msbot/bin/msbot", sys.executable)
        (folder / f"msbot-{name}").write_text(text, "utf-8")
    return folder


def test_no_unit_has_a_place_that_was_not_filled(folder: Path) -> None:
    assert [path.name for path in folder.iterdir() if "@CONF" in path.read_text()] == []
    assert {"master.service", "standby.service", "agent.service", "backup.service", "backup.timer"} <= set(UNITS)


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here: apt-get install systemd")
@pytest.mark.parametrize("name", ["master", "standby", "agent", "backup"])
@pytest.mark.promise("Services of the Debian package may do little: systemd-analyze security says less than 3")
def test_a_service_may_do_little(name: str, folder: Path) -> None:
    place = str(folder / f"msbot-{name}.service")
    command = ["systemd-analyze", "security", "--offline=true", "--threshold=30", "--no-pager", place]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    found = re.search(r"Overall exposure level for .*: ([\d.]+)", done.stdout)
    assert found is not None
    assert float(found[1]) < 3


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="no systemd here: apt-get install systemd")
def test_systemd_finds_no_mistake_in_the_units(folder: Path) -> None:
    command = [
        "systemd-analyze",
        "verify",
        "--man=no",
        *(str(folder / f"msbot-{name}") for name in UNITS if "@" not in name),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert [line for line in done.stderr.splitlines() if "msbot" in line] == []
    assert done.returncode == 0


def test_rules_for_adapters_are_whole() -> None:
    """Each GOTO has its label, and no line has a comparison that is an assignment."""
    lines = [line for line in (FILES / "60-msbot.rules").read_text().splitlines() if line and line[0] != "#"]
    labels = {found[1] for line in lines if (found := re.match(r'LABEL="(\w+)"', line))}
    assert {found for line in lines for found in re.findall(r'GOTO="(\w+)"', line)} == labels
    keys = re.compile(
        r'(?:ACTION|SUBSYSTEMS?|KERNEL|ATTRS?\{\w+\}|ENV\{DEVTYPE\})(?:==|!=)"[^"]+"|GOTO="\w+"|LABEL="\w+"'
    )
    rules = re.compile(r'(?:GROUP|MODE)="\w+"|TAG\+="\w+"|ENV\{\w+\}\+?="[^"]+"')
    for line in lines:
        # Keys of devices above, in the plural, also match the device itself: a "!=" among them would always hold.
        assert not re.search(r"(?:SUBSYSTEMS|ATTRS\{\w+\}|KERNELS|DRIVERS)!=", line), line
        for word in re.split(r",\s*", line):
            assert keys.fullmatch(word) or rules.fullmatch(word), f"{word} of {line}"


def test_what_a_person_may_change_is_kept_by_dpkg() -> None:
    assert {path.name for path in FILES.glob("*.env")} == {name for name in CONFIGURED if name.endswith(".env")}
    for name in CONFIGURED[1:]:
        assert (FILES / name).read_text().startswith("# ")


def test_the_list_of_installed_files_knows_programs_as_they_are_in_the_package(tmp_path: Path) -> None:
    site = tmp_path / "lib/python3.11/site-packages"
    program = tmp_path / "bin/msbot"
    site.mkdir(parents=True)
    program.parent.mkdir()
    program.write_bytes(b"#!/usr/lib/msbot/bin/python3\n")
    kept = "msbot/__init__.py,sha256=abc,12\n"
    record = f"../../../bin/msbot,sha256=of_another_file,99\n{kept}msbot.dist-info/uv_cache.json,sha256=abc,5\n"
    digest = base64.urlsafe_b64encode(hashlib.sha256(program.read_bytes()).digest()).decode().rstrip("=")
    assert list(debian_package.recorded(record, site)) == [f"../../../bin/msbot,sha256={digest},29\n", kept]


def test_a_package_has_programs_for_its_own_processor_only(tmp_path: Path) -> None:
    elf = b"\x7fELF" + bytes(14)
    for name, machine, mode in (("a.so.1", 183, 0o644), ("b.so", 62, 0o644), ("c", 62, 0o755), ("data", 62, 0o644)):
        (tmp_path / name).write_bytes(elf + machine.to_bytes(2, "little"))
        (tmp_path / name).chmod(mode)
    (tmp_path / "script").write_text("#!/bin/sh\n")
    (tmp_path / "script").chmod(0o755)
    assert debian_package._of_another_machine(tmp_path, "arm64") == [Path("b.so"), Path("c")]
    assert debian_package._of_another_machine(tmp_path, "amd64") == [Path("a.so.1")]


def test_everybody_may_read_what_somebody_with_private_files_has_made(tmp_path: Path) -> None:
    tree, before = tmp_path / "root", os.umask(0o077)
    try:
        (tree / "usr/bin").mkdir(parents=True)
        (tree / "usr/bin/text").touch()
        (tree / "usr/bin/program").touch(0o700)
        (tree / "usr/bin/link").symlink_to("../../../elsewhere")
    finally:
        os.umask(before)
    debian_package.make_public(tree)
    modes = {path.name: path.stat().st_mode & 0o777 for path in (tree, *tree.rglob("*")) if path.name != "link"}
    assert modes == {"root": 0o755, "usr": 0o755, "bin": 0o755, "text": 0o644, "program": 0o755}


def test_a_processor_without_wheels_is_refused(tmp_path: Path) -> None:
    if shutil.which("dpkg-deb") is None or not debian_package.PYTHON.exists():
        pytest.skip("a package is made on Debian")
    with pytest.raises(debian_package.CannotBuild, match=r"no package is made here for 'mips', but for amd64, arm64"):
        debian_package.build(tmp_path, "0.0.1", "mips")


# What it does in a clean system.


@pytest.fixture(scope="module")
def archive() -> Path:
    """A clean Debian, packed."""
    return clean_debian()


def clean_debian() -> Path:
    """A clean Debian, packed; the test is skipped where none can be made."""
    if os.geteuid() != 0 or not all(map(shutil.which, ("mmdebstrap", "dpkg-deb", "chroot"))):
        if NEEDED:
            pytest.fail("MSBOT_NEED_DEB is set, and there is no mmdebstrap, dpkg-deb or chroot, or this is not root")
        pytest.skip("a clean Debian takes root and mmdebstrap: apt-get install mmdebstrap")
    if debian_package.release() != SUITE:
        pytest.skip(f"the package is for the Debian that it is built on, and this is not {SUITE}")
    kept = ROOT / "build" / f"{SUITE}.tar"
    if not kept.exists():
        kept.parent.mkdir(exist_ok=True)
        command = ["mmdebstrap", "--quiet", "--variant=minbase", f"--include={INCLUDED}", SUITE, str(kept)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            kept.unlink(missing_ok=True)
            pytest.skip(f"mmdebstrap made no {SUITE}: {done.stderr.strip().splitlines()[-1]}")
    return kept


@pytest.fixture
def root(archive: Path, tmp_path: Path) -> Iterator[Path]:
    """The clean Debian."""
    folder = tmp_path / "root"
    unpack(archive, folder)
    yield folder
    shutil.rmtree(folder)


def unpack(archive: Path, folder: Path) -> None:
    """The clean Debian, as a system that was started has it."""
    folder.mkdir(mode=0o755)
    subprocess.run(["tar", "--extract", "--file", str(archive), "--directory", str(folder)], check=True)
    (folder / "dev/shm").mkdir(exist_ok=True)
    (folder / "dev/shm").chmod(0o1777)


@pytest.fixture(scope="module")
def commit() -> str:
    """What the package is made of; empty: files that are not committed."""
    return debian_package.source()[0]


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory, commit: str) -> list[Path]:
    """The package, by somebody whose new files are for nobody else; and the same as a later version."""
    into, before = tmp_path_factory.mktemp("made"), os.umask(0o077)
    try:
        first = debian_package.build(into, VERSIONS[0])
    finally:
        os.umask(before)
    folder = tmp_path_factory.mktemp("later")
    subprocess.run(["dpkg-deb", "--raw-extract", str(first), str(folder / "tree")], check=True)
    control = folder / "tree/DEBIAN/control"
    control.write_text(control.read_text().replace(f"Version: {VERSIONS[0]}\n", f"Version: {VERSIONS[1]}\n"))
    master = folder / "tree/etc/msbot/agent.env"
    master.write_text(master.read_text() + "# a later version\n")
    later = folder / "later.deb"
    command = ["dpkg-deb", "--root-owner-group", "-Znone", "--build", str(folder / "tree"), str(later)]
    subprocess.run(command, check=True, capture_output=True)
    return [first, later]


def inside(root: Path, *command: str, user: str = "") -> str:
    """Run something in the clean system; returns what it says."""
    words = [
        "chroot",
        *([f"--userspec={user}"] if user else []),
        str(root),
        "env",
        "-i",
        "PATH=/usr/sbin:/usr/bin:/sbin:/bin",
    ]
    words += ["HOME=/var/lib/msbot", "LC_ALL=C.UTF-8", "DEBIAN_FRONTEND=noninteractive", *command]
    done = subprocess.run(words, capture_output=True, text=True, check=False, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def files(root: Path) -> set[str]:
    """What is there, besides what dpkg and the linker note down."""
    skipped = ("var/lib/dpkg", "var/log", "var/cache", "etc/ld.so.cache", "proc", "sys", "dev", "tmp", "run")
    found = {str(path.relative_to(root)) for path in root.rglob("*")}
    return {path for path in found if not path.startswith(skipped)}


@pytest.mark.slow
@pytest.mark.timeout(1800)
@pytest.mark.promise(
    "The Debian package is installed, upgraded, removed and purged without a trace that it does not name"
)
def test_install_upgrade_remove_purge(root: Path, packages: list[Path], commit: str) -> None:
    before = files(root)
    for number, package in enumerate(packages):
        shutil.copy(package, root / f"{number}.deb")

    inside(root, "dpkg", "--force-unsafe-io", "--install", "/0.deb")
    said = inside(root, "msbot", "--version").strip()
    assert said == f"msbot {version.read()} ({f'build {commit[:12]}' if commit else 'from a working tree'})"
    assert "/usr/bin/env --block-signal=INT /usr/lib/msbot/bin/python3 " in (root / "usr/bin/msbot").read_text()
    bill = json.loads((root / f"usr/share/doc/msbot/msbot-{version.read()}.cdx.json").read_text())
    assert {"msbot-agent", "nicegui"} <= {one["name"] for one in bill["components"]}
    assert inside(root, "id", "-un", "msbot") == "msbot\n"
    assert "dialout" in inside(root, "id", "-Gn", "msbot")
    assert not (root / "usr/lib/msbot/.lock").exists()
    assert inside(root, "find", "/usr/lib/msbot", "/etc/msbot", "-perm", "/022", "!", "-type", "l") == ""
    assert "msbot" in inside(
        root, "bash", "-c", "source /usr/share/bash-completion/completions/msbot; complete -p msbot"
    )

    # A robot works as that user, with the unit's options, and stores what it knows.
    inside(root, "install", "-d", "-o", "msbot", "-g", "msbot", "-m", "0700", "/var/lib/msbot")
    (root / "etc/msbot/master.env").write_text("# mine\nMSBOT_MASTER=\n")
    robot = "/usr/lib/msbot/bin/msbot master /etc/msbot/robot.toml --db /var/lib/msbot/robot.db"
    robot += " --port 0 --link udp:127.0.0.1:0"
    script = (
        f"cd /var/lib/msbot; PYTHONUNBUFFERED=1 MSBOT_STOP_GROUP=deb {robot} >/tmp/log 2>&1 & id=$!;"
        "for i in $(seq 600); do grep -q http:// /tmp/log && break; sleep 0.2; done;"
        "port=$(grep -o 'http://127.0.0.1:[0-9]*' /tmp/log | head -1);"
        "/usr/bin/python3 -c 'import sys, urllib.request; print(urllib.request.urlopen(sys.argv[1]).read().decode())'"
        " $port/api/health; kill $id; wait $id; cat /tmp/log"
    )
    said = inside(root, "bash", "-c", script, user="msbot:msbot")
    assert '{"status":"ok"}' in said, said
    database = root / "var/lib/msbot/robot.db"
    assert database.stat().st_uid == int(inside(root, "id", "-u", "msbot"))

    # Whoever changed a file keeps it; what nobody changed is the new one's.
    inside(root, "dpkg", "--force-unsafe-io", "--force-confold", "--install", "/1.deb")
    assert (root / "etc/msbot/master.env").read_text() == "# mine\nMSBOT_MASTER=\n"
    assert (root / "etc/msbot/agent.env").read_text().endswith("# a later version\n")
    assert database.exists()
    inside(root, "/usr/lib/msbot/bin/msbot", "db", "check", "--db", "/var/lib/msbot/robot.db", user="msbot:msbot")

    inside(root, "dpkg", "--remove", "msbot")
    assert not (root / "usr/lib/msbot").exists()
    assert not (root / "usr/bin/msbot").is_symlink()
    assert database.exists()
    assert (root / "etc/msbot/master.env").exists()

    inside(root, "dpkg", "--purge", "msbot")
    for number, _ in enumerate(packages):
        (root / f"{number}.deb").unlink()
    assert {path for path in files(root) - before if not path.startswith("etc/")} == set()
    assert {path for path in files(root) - before if path.startswith("etc/msbot")} == set()


TRIAL = """#!/bin/bash
exec >/dev/console 2>&1
well() { for i in $(seq 150); do
    python3 -c 'import urllib.request as r; r.urlopen("http://127.0.0.1:8080/api/health")' 2>/dev/null && break
    sleep 0.5; done; echo "$1: $(systemctl is-active msbot-master)"; }
systemctl enable --now msbot-master msbot-backup.timer
well started
systemctl kill --signal KILL msbot-master
sleep 1
well killed
echo "restarts: $(systemctl show msbot-master --property NRestarts --value)"
systemctl start msbot-backup
echo "backups: $(ls /var/lib/msbot/backups | wc -l)"
msbot stop | grep -o 'STOP holds'
systemctl start msbot-standby
for i in $(seq 300); do [ "$(systemctl is-active msbot-master)" = deactivating ] || break; sleep 0.2; done
echo "beside a standby: $(systemctl is-active msbot-master)"
systemctl start msbot-agent
for i in $(seq 100); do journalctl -u msbot-agent | grep -q 'agent on udp' && break; sleep 0.5; done
echo "agent: $(systemctl is-active msbot-agent)"
echo TRIAL-END
systemctl poweroff --force --force
"""
UPGRADE = """#!/bin/bash
exec >/dev/console 2>&1
robot() { runuser -u msbot -- msbot "$@" --db /var/lib/msbot/robot.db; }
well() { for i in $(seq 200); do
    python3 -c 'import urllib.request as r; r.urlopen("http://127.0.0.1:8080/api/health")' 2>/dev/null && break
    sleep 0.5; done; echo "$1: $(systemctl is-active msbot-master), $(dpkg-query -W -f '${Version}' msbot)"; }
part() { for i in $(seq 60); do robot parts | grep -q 'AA *active' && break; sleep 0.5; done
    echo "$1: $(robot parts | grep -o 'AA *active' | tr -s ' ')"; }
echo '# mine' >> /etc/msbot/master.env
systemctl enable --now msbot-master msbot-backup.timer
well started
systemd-run --quiet --unit trial-part --uid msbot --working-directory=/var/lib/msbot --setenv HOME=/var/lib/msbot \
    --setenv XDG_RUNTIME_DIR=/run/msbot msbot part ABCD --link udp:127.0.0.1:8888
part 'a part joins'
echo 'correct horse' | robot user add grace --role administrator --password-stdin
msbot stop | grep -o 'the one part has confirmed it'
process=$(systemctl show msbot-master --property MainPID --value)
dpkg --force-confold --install /1.deb
well upgraded
[ "$(systemctl show msbot-master --property MainPID --value)" = "$process" ] || echo 'in a new process'
part 'the part stays'
echo "people: $(robot user list | grep -o grace)"
journalctl -u msbot-master | grep -o 'STOP holds since before'
echo "kept: $(tail -1 /etc/msbot/master.env)"
echo "timer: $(systemctl is-active msbot-backup.timer)"
systemctl stop trial-part
dpkg --remove msbot
echo "removed: $(systemctl is-active msbot-master msbot-backup.timer | tr '\n' ' ')"
echo "programs: $(ls -d /usr/lib/msbot /usr/bin/msbot /usr/lib/systemd/system/msbot-* 2>/dev/null | wc -l)"
echo "enabled: $(find /etc/systemd /run/systemd -name 'msbot-*' | wc -l)"
echo "still there: $(ls -d /etc/msbot/master.env /var/lib/msbot/robot.db | wc -l), $(id -un msbot)"
dpkg --force-confold --install /1.deb
systemctl enable --now msbot-master
well 'installed again'
echo "people, again: $(robot user list | grep -o grace)"
systemctl start msbot-agent
systemctl enable --now msbot-backup.timer
dpkg --purge msbot
echo "purged: $(systemctl is-active msbot-master msbot-agent msbot-backup.timer | tr '\n' ' ')"
echo "left: $(find / /run -xdev -iname '*msbot*' | tr '\n' ' ')"
echo TRIAL-END
systemctl poweroff --force --force
"""
UNIT = "[Unit]\nAfter=multi-user.target\n[Service]\nExecStart=/trial\n"


def said_by_a_machine(root: Path, script: str, folder: Path, disks: Sequence[Path] = (), within_s: float = 900) -> str:
    """What a script says in a machine with a kernel and a systemd of its own (User-Mode Linux), after each start.

    Args:
        root: its root.
        script: a program that runs when the system is there.
        folder: for its disk.
        disks: further ones.
        within_s: then it is ended.
    """
    ready = subprocess.run([ROOT / "tools/run-in-vm.sh", "--ready", "uml"], check=False)
    kernel = Path(os.environ.get("MSBOT_VM_CACHE") or Path.home() / ".cache/msbot-vm") / "uml/usr/bin/linux.uml"
    if ready.returncode or not kernel.exists() or shutil.which("mke2fs") is None:
        pytest.skip("it takes a virtual machine and mke2fs: make vm; apt-get install e2fsprogs")
    (root / "trial").write_text(script)
    (root / "trial").chmod(0o755)
    wanted = root / "etc/systemd/system/multi-user.target.wants"
    wanted.mkdir(parents=True, exist_ok=True)
    (wanted.parent / "trial.service").write_text(UNIT)
    (wanted / "trial.service").symlink_to("../trial.service")
    disk = folder / "disk"
    with disk.open("wb") as file:
        file.truncate(2 << 30)
    subprocess.run(["mke2fs", "-q", "-t", "ext4", "-d", str(root), str(disk)], check=True)
    command = [str(kernel), "mem=1200M", f"ubd0={disk}", "root=/dev/ubda", "rw", "init=/lib/systemd/systemd"]
    command += [f"ubd{number}={path}" for number, path in enumerate(disks, 1)]
    command += ["con=null", "con0=null,fd:1", "quiet"]
    log = folder / "log"
    with log.open("wb") as output:
        machine = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT, start_new_session=True
        )
        try:
            machine.wait(within_s)
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(machine.pid, signal.SIGKILL)
            disk.unlink()
    return log.read_text("utf-8", "replace")


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_services_run_under_systemd(root: Path, packages: list[Path], tmp_path: Path) -> None:
    """They are confined as they are for everybody."""
    shutil.copy(packages[0], root / "0.deb")
    inside(root, "dpkg", "--force-unsafe-io", "--install", "/0.deb")
    (root / "0.deb").unlink()
    said = said_by_a_machine(root, TRIAL, tmp_path)
    for line in ("started: active", "killed: active", "restarts: 1", "backups: 1", "STOP holds", "agent: active"):
        assert line in said, said
    assert "beside a standby: inactive" in said  # two masters of one computer would be one too many


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.promise(
    "A running robot takes the next Debian package and loses no part, person or STOP; removing it leaves the data"
)
def test_a_running_robot_is_upgraded_and_removed(root: Path, packages: list[Path], tmp_path: Path) -> None:
    for number, package in enumerate(packages):
        shutil.copy(package, root / f"{number}.deb")
    inside(root, "dpkg", "--force-unsafe-io", "--install", "/0.deb")
    said = said_by_a_machine(root, UPGRADE, tmp_path)
    lines = [line.strip() for line in said.splitlines()]
    expected = [
        f"started: active, {VERSIONS[0]}",
        "a part joins: AA active",
        "the one part has confirmed it",
        f"upgraded: active, {VERSIONS[1]}",
        "in a new process",
        "the part stays: AA active",
        "people: grace",
        "STOP holds since before",
        "kept: # mine",
        "timer: active",
        "removed: inactive inactive",
        "programs: 0",
        "enabled: 0",
        "still there: 2, msbot",
        f"installed again: active, {VERSIONS[1]}",
        "people, again: grace",
        "purged: inactive inactive inactive",
        "left:",
    ]
    assert [line for line in expected if line not in lines] == [], said

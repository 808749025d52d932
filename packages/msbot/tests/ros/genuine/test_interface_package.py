"""`msbot library ros-package`: genuine ROS 2 reads its files, and gives their types the hashes that we give them."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

from msbot.cli.ros_package import package_files, services_of, write_package
from msbot.part.messages.ros_names import PACKAGE, ros_name, service_stem
from msbot.ros2.package_types import package_hash, service_classes, service_hash
from msbot.sim.model_part import message_class
from tests.cli.library.ros_packages import library, ros_hash, service_hashes
from tests.ros.genuine.environment import command, environment, surroundings


def test_ros_reads_the_package_and_its_hashes_are_ours(tmp_path: Path) -> None:
    own = library(tmp_path)
    write_package(package_files(own), tmp_path / PACKAGE)
    share = str(environment() / "share")
    done = subprocess.run(
        command("interface_hashes.py", str(tmp_path / PACKAGE), PACKAGE, share),
        env=surroundings(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    theirs = {name: one.removeprefix("RIHS01_")[:16] for name, one in json.loads(done.stdout.splitlines()[-1]).items()}
    ours = {ros_name(name): ros_hash(one) for name, one in own.messages.items()}
    for service, messages in services_of(own).items():
        ours |= service_hashes(service_stem(*service), *messages)
    assert len(ours) == len(own.messages) + 4
    assert {name: theirs[name] for name in ours} == ours
    told = json.loads(done.stdout.splitlines()[-1])
    for service, (request, reply) in services_of(own).items():
        stem = service_stem(*service)
        made = service_classes(message_class(request), message_class(reply), PACKAGE, stem)
        assert told[f"{PACKAGE}/srv/{stem}"] == f"RIHS01_{service_hash(*made)}"
        for end, one in zip(("Request", "Response"), made, strict=True):
            assert told[f"{PACKAGE}/srv/{stem}_{end}"] == f"RIHS01_{package_hash(one)}"

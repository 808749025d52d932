"""Writing the sample blueprint: it is right, and nothing is ever overwritten."""

from io import StringIO
from pathlib import Path

import pytest

from msbot.config.blueprint.blueprint_file_reader import load_blueprint
from msbot.config.blueprint.samples import SAMPLE_ROBOT_TOML, write_sample
from msbot.config.library.part_library import load_library
from msbot_xrce.errors import ConfigError


def _refused(path: Path) -> str:
    with pytest.raises(ConfigError) as caught:
        write_sample(path)
    return str(caught.value)


def test_the_sample_is_the_thesis_robot(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    write_sample(path)
    assert path.read_text() == SAMPLE_ROBOT_TOML
    blueprint = load_blueprint(path, load_library())
    robot = blueprint.robot
    assert (robot.name, robot.version, robot.serial_number, robot.released, robot.manufacturer) == (
        "MSBOT_MASTER",
        "MSBOT_V1",
        "X100Y100Z100",
        "8-4-2021",
        "MASSEY_ENGINEERING_DEP",
    )
    assert [(slot.name, slot.part_number, slot.local_name) for slot in blueprint.slots] == [
        ("AA", "ABCD", "ABCD-local"),
        ("BB", "EFGH", "EFGH-local"),
        ("CC", "WXYZ", "WXYZ-local"),
    ]
    assert [(binding.topic, binding.type_name) for binding in blueprint.bindings] == [
        ("HelloWorldTopic_1_to_2", "HelloWorld"),
        ("HelloWorldTopic_2_to_3", "HelloWorld"),
        ("HelloWorldTopic_3_to_1", "HelloWorld"),
    ]
    wires = [(binding.source.slot, binding.targets[0].slot) for binding in blueprint.bindings]
    assert wires == [("AA", "BB"), ("BB", "CC"), ("CC", "AA")]


def test_the_values_in_its_comments_are_right_too(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    lines = [line.removeprefix("# ") if " = " in line else line for line in SAMPLE_ROBOT_TOML.splitlines()]
    path.write_text("\n".join(line for line in lines if not line.startswith("period_s")))
    blueprint = load_blueprint(path, load_library())
    assert blueprint.timing.beat_period_s == 1.0


def test_an_existing_file_is_never_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "robot.toml"
    path.write_text("mine")
    assert _refused(path) == (
        f"{path}: exists already and is not overwritten; choose another name, for example {tmp_path}/robot2.toml"
    )
    assert path.read_text() == "mine"


def test_the_other_name_is_free(tmp_path: Path) -> None:
    for name in ("robot.toml", "robot2.toml"):
        (tmp_path / name).touch()
    assert _refused(tmp_path / "robot.toml").endswith(f"for example {tmp_path}/robot3.toml")


def test_a_directory_is_no_file(tmp_path: Path) -> None:
    assert _refused(tmp_path) == f"{tmp_path}: is a directory; choose another name, for example {tmp_path}/robot.toml"


def test_a_missing_folder(tmp_path: Path) -> None:
    path = tmp_path / "no" / "robot.toml"
    assert _refused(path) == f"{path}: there is no folder {tmp_path}/no; create it with `mkdir -p {tmp_path}/no`"


def test_no_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    path = tmp_path / "robot.toml"
    assert _refused(path) == f"{path}: no permission to write in {tmp_path}; choose another folder"


def test_a_name_the_system_does_not_take(tmp_path: Path) -> None:
    assert "cannot be written (File name too long); choose another name" in _refused(tmp_path / ("x" * 300))
    assert "cannot be written (embedded null byte); choose another name" in _refused(Path("a\0b"))


def test_a_full_disk_leaves_no_half_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "robot.toml"

    class FullDisk(StringIO):
        def write(self, _text: str) -> int:
            raise OSError(28, "No space left on device")

    def open_full(*_: object, **__: object) -> FullDisk:
        path.touch()
        return FullDisk()

    monkeypatch.setattr(Path, "open", open_full)
    assert _refused(path) == f"{path}: cannot be written (No space left on device); make room or choose another disk"
    assert not path.exists()

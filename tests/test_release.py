"""What `make release` makes: versions in lockstep, builds that are the same, a bill of materials."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
from cyclonedx.model.bom import Bom

from msbot_agent.cli.build_name import commit_of_build, version_words
from tools import version
from tools.release import building, sbom
from tools.sources import ROOT

EPOCH = 1_700_000_000
COMMIT = "0123456789abcdef0123456789abcdef01234567"


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """The files that name the version, in a folder of their own."""
    for pattern in {files for files, _ in version.PLACES} | {"CHANGELOG.md"}:
        for path in ROOT.glob(pattern):
            target = tmp_path / path.relative_to(ROOT)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, target)
    return tmp_path


def test_one_call_writes_the_version_everywhere(copy: Path) -> None:
    version.write("7.8.9rc1", copy)
    assert version.read(copy) == "7.8.9rc1"
    assert "\n## [Unreleased]\n\n## [7.8.9rc1]\n" in (copy / "CHANGELOG.md").read_text("utf-8")
    assert 'msbot-agent==7.8.9rc1"' in (copy / "packages/msbot/pyproject.toml").read_text("utf-8")
    assert re.search(
        r'"msbot-bridges\[[\w,-]+\]==7\.8\.9rc1"', (copy / "packages/msbot/pyproject.toml").read_text("utf-8")
    )


def test_a_version_that_is_forgotten_is_named_with_its_file(copy: Path) -> None:
    project = copy / "packages/msbot-web/pyproject.toml"
    project.write_text(project.read_text("utf-8").replace('version = "', 'version = "9', 1), "utf-8")
    with pytest.raises(version.VersionError, match=r"packages/msbot-web/pyproject\.toml"):
        version.read(copy)


@pytest.mark.parametrize("wrong", ["1.2", "v1.2.3", "1.2.3-rc1", "latest", ""])
def test_what_is_no_version_is_refused(wrong: str, copy: Path) -> None:
    with pytest.raises(version.VersionError, match="three numbers"):
        version.write(wrong, copy)


def test_the_changelog_has_to_say_something() -> None:
    text = "## [Unreleased]\n\n## [0.2.0]\n\n## [0.1.0]\n\nThe first version.\n"
    assert version.section("0.1.0", text) == "The first version.\n"
    with pytest.raises(version.VersionError, match=r"0\.2\.0"):
        version.section("0.2.0", text)


def test_the_project_itself_could_be_released() -> None:
    assert version.section(version.read(), (ROOT / "CHANGELOG.md").read_text("utf-8"))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """sdist and wheel of a distribution that carries folders of others, from a copy of the sources."""
    tree = tmp_path_factory.mktemp("tree")
    ignored = shutil.ignore_patterns("__pycache__", "tests")
    shutil.copytree(ROOT / "packages/msbot-school", tree / "packages/msbot-school", ignore=ignored)
    shutil.copytree(ROOT / "lessons", tree / "lessons", ignore=ignored)
    into = tmp_path_factory.mktemp("made")
    building._hatchling(
        tree / "packages/msbot-school", into, {"SOURCE_DATE_EPOCH": str(EPOCH)}, "-t", "sdist", "-t", "wheel"
    )
    return sorted(into.iterdir())


def test_the_wheel_of_an_sdist_is_the_wheel(made: list[Path], tmp_path: Path) -> None:
    wheel, sdist = sorted(made, key=lambda path: path.suffix, reverse=True)
    again = building.build_from_sdist(sdist, tmp_path, EPOCH)
    building.check_same([wheel], [again])


def test_an_octet_of_difference_is_found(made: list[Path], tmp_path: Path) -> None:
    other = tmp_path / made[0].name
    other.write_bytes(made[0].read_bytes()[:-1] + b"!")
    with pytest.raises(building.ReleaseError, match=made[0].name):
        building.check_same([made[0]], [other])
    with pytest.raises(building.ReleaseError, match="only one"):
        building.check_same(made, made[:1])


def test_a_folder_packs_the_same_whenever_it_was_written(tmp_path: Path) -> None:
    packed = []
    for name in ("one", "two"):
        folder = tmp_path / name / "site"
        (folder / "sub").mkdir(parents=True)
        (folder / "sub" / "a.html").write_text("a")
        (folder / "b.html").write_text("b")
        packed.append(building.pack(folder, "site", folder.parent, EPOCH).read_bytes())
        (folder / "b.html").touch()
    assert packed[0] == packed[1]


def test_the_sums_are_those_of_the_files(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"abc")
    text = building.write_sums(tmp_path).read_text()
    assert text == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad  a\n"  # FIPS 180-2, B.1


def test_the_bill_of_materials_names_all_with_licences(tmp_path: Path) -> None:
    wheels = []
    for name in building.DISTRIBUTIONS:
        wheels.append(tmp_path / f"{name.replace('-', '_')}-0.1.0-py3-none-any.whl")
        wheels[-1].write_bytes(name.encode())
    text = sbom.bill("0.1.0", COMMIT, EPOCH, wheels)
    assert text == sbom.bill("0.1.0", COMMIT, EPOCH, wheels)
    told = json.loads(text)
    assert (told["bomFormat"], told["specVersion"]) == ("CycloneDX", "1.6")
    components = {one["name"]: one for one in told["components"]}
    assert {"msbot-web", "nicegui", "click", "sqlalchemy", "blockly", "uplot", "pymunk", "psycopg"} <= set(components)
    assert not {"pytest", "ruff", "zensical", "cyclonedx-python-lib"} & set(components)
    assert [name for name, one in components.items() if not one.get("licenses")] == []
    assert components["nicegui"]["purl"].startswith("pkg:pypi/nicegui@")
    assert all(one["hashes"] for name, one in components.items() if name in building.DISTRIBUTIONS)
    needs = {one["ref"]: one.get("dependsOn", []) for one in told["dependencies"]}
    assert "msbot-xrce@0.1.0" in needs["msbot-agent@0.1.0"]
    read = Bom.from_json(told)  # the library reads it back
    assert len(read.components) == len(told["components"])


def test_msbot_says_which_build_it_is() -> None:
    assert commit_of_build(COMMIT + "\n") == "0123456789ab"
    assert commit_of_build("$Format:%H$\n") is None
    assert version_words() == f"msbot {version.read()} (from a working tree)"

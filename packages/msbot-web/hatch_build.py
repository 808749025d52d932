"""What the package carries of the project's other folders: from there, or from `carried/`, where an sdist has a copy.

Which folder goes to which place: `[tool.hatch.build.hooks.custom.carried]` of pyproject.toml. The distributions that
carry something have the same copy of this file: each of them is built alone.
"""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CarriedFolders(BuildHookInterface[Any]):
    """Adds the folders to whatever is built."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002 - hatchling calls it so
        """Name the folders; hatchling fails if one is missing."""
        for source, place in self.config["carried"].items():
            copy = PurePosixPath("carried", place)
            has_copy = (Path(self.root) / copy).is_dir()
            goes_to = copy.as_posix() if self.target_name == "sdist" else place
            build_data["force_include"][copy.as_posix() if has_copy else source] = goes_to

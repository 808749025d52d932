"""What the package carries of the project's other folders: from there, or from `carried/`, where an sdist has a copy.

Which folder goes to which place: `[tool.hatch.build.hooks.custom.carried]` of pyproject.toml. Besides, the man pages
that `tools/man_pages.py` has written into `build/man`, if it has. The distributions that carry something have the same
copy of this file: each of them is built alone.
"""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class CarriedFolders(BuildHookInterface[Any]):
    """Adds the folders to whatever is built."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Name the folders; hatchling fails if one is missing, but for the man pages."""
        for source, place in self.config.get("carried", {}).items():
            copy = PurePosixPath("carried", place)
            has_copy = (Path(self.root) / copy).is_dir()
            goes_to = copy.as_posix() if self.target_name == "sdist" else place
            build_data["force_include"][copy.as_posix() if has_copy else source] = goes_to
        pages = [page for folder in ("build/man", "carried/man") for page in Path(self.root, folder).glob("*.1")]
        for page in pages if version != "editable" else ():
            if self.target_name == "sdist":
                build_data["force_include"][str(page)] = f"carried/man/{page.name}"
            else:
                build_data["shared_data"][str(page)] = f"share/man/man1/{page.name}"

"""The sample robot `makers`: parts of MsBOT beside simulated devices of other worlds, made with their own libraries"""

from __future__ import annotations

import shutil
from pathlib import Path

_HERE = Path(__file__).parent


def write_sample(path: Path) -> None:
    """Write the blueprint there, and beside it the part types that its devices have described."""
    shutil.copytree(_HERE / "adopted", path.parent / "adopted", dirs_exist_ok=True)
    shutil.copyfile(_HERE / "robot.toml", path)

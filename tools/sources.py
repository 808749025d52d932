"""Where the sources of the six distributions are."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = tuple(
    ROOT / "packages" / distribution / "src" / distribution.replace("-", "_")
    for distribution in ("msbot-xrce", "msbot-agent", "msbot", "msbot-school", "msbot-bridges", "msbot-web")
)
"""The folders of the import packages, from the lowest up."""


def source_files() -> list[Path]:
    """Every Python file of the product."""
    return [path for package in PACKAGES for path in sorted(package.rglob("*.py"))]


def dotted(path: Path) -> str:
    """The name of a module or package, from its path."""
    package = next(package for package in PACKAGES if path.is_relative_to(package))
    parts = path.relative_to(package.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)

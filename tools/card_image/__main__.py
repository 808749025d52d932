"""Makes the image of an SD card for the Raspberry Pi.

    .venv/bin/python -m tools.card_image build/image [--kept FOLDER] [--package FILE]        (or: make image)

1. Debian for 64-bit Arm by mmdebstrap, with what packaging/image/packages.txt names; kept for the next build;
2. the Debian package of MsBOT, made here for 64-bit Arm;
3. the card's own files, packaging/image; an initramfs; three file systems and a partition table.

It needs root, and says which programs are missing.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from tools import debian_package
from tools.card_image import card
from tools.card_image.base import ARCHITECTURE, PROGRAMS, SUITE, ImageError, need_programs, need_root
from tools.version import read


def main() -> int:
    """Make it; returns 1 with the reason if that does not work."""
    parser = argparse.ArgumentParser(prog="make image")
    parser.add_argument("into", type=Path)
    parser.add_argument("--kept", type=Path, help="what the next build uses again; INTO/kept unless given")
    parser.add_argument("--package", type=Path, help="the Debian package, if it is made already")
    asked = parser.parse_args()
    kept = asked.kept or asked.into / "kept"
    try:
        need_root()
        need_programs(PROGRAMS)
        if debian_package.release() != SUITE:
            raise ImageError(f"the package of MsBOT is for the Debian that it is made on: use {SUITE}")
        package = asked.package or debian_package.build(kept, read(), ARCHITECTURE)
        image = card.make(asked.into, kept.absolute(), package.absolute())
    except (ImageError, debian_package.CannotBuild) as error:
        sys.stderr.write(f"image: {error}\n")
        return 1
    sys.stdout.write(f"{image}  {image.stat().st_size / 1e6:.0f} MB\n")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

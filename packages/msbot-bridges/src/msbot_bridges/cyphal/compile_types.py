"""`python -m msbot_bridges.cyphal.compile_types FOLDER`: see `data_types`; says what is wrong in its last line."""

from __future__ import annotations

import logging
import os
import sys
from pathlib import Path


def main(folder: str) -> int:
    """Compile."""
    from msbot_bridges.cyphal.data_types import compile_types

    os.umask(0o077)  # these modules are imported: nobody else may put any there
    os.environ["PYCYPHAL_NO_IMPORT_HOOK"] = "1"
    logging.disable(logging.WARNING)
    compile_types(Path(folder))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))

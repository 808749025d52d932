"""What genuine ROS 2 makes of the .msg and .srv files of a package: type names with their hashes, as JSON.

It runs with the Python of its own environment, and imports nothing of MsBOT.
"""

import json
import sys
import tempfile
from pathlib import Path

from rosidl_adapter import convert_to_idl
from rosidl_generator_type_description import generate_type_hash


def main(folder: str, package: str, share: str) -> None:
    source, made = Path(folder), Path(tempfile.mkdtemp())
    files = sorted(path.relative_to(source) for path in [*source.glob("msg/*.msg"), *source.glob("srv/*.srv")])
    idl = [convert_to_idl(source, package, path, made).relative_to(made) for path in files]
    told = {
        "package_name": package,
        "output_dir": str(made),
        "idl_tuples": [f"{made}:{path}" for path in idl],
        "include_paths": [f"{one}:{share}/{one}" for one in ("service_msgs", "builtin_interfaces")],
    }
    (made / "arguments.json").write_text(json.dumps(told))
    generate_type_hash(str(made / "arguments.json"))
    hashes = {}
    for path in idl:
        for one in json.loads((made / path).with_suffix(".json").read_text())["type_hashes"]:
            hashes[one["type_name"]] = one["hash_string"]
    print(json.dumps(hashes))


main(*sys.argv[1:])

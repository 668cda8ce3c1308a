"""Runs rosidl, the generator of ROS 2 itself, on a package of messages. Runs where its modules are found.

Prints an object: for each message type its hash, and the names of its fields.

    python by_rosidl.py PACKAGE_FOLDER SHARE_FOLDER
"""

from __future__ import annotations

import contextlib
import json
import sys
from pathlib import Path

from rosidl_adapter.msg import convert_msg_to_idl  # type: ignore[import-not-found]
from rosidl_generator_type_description import generate_type_hash  # type: ignore[import-not-found]


def main(package: Path, share: Path) -> None:
    """``share``: where the types of other packages are described."""
    out = package / "idl"
    names = sorted(path.stem for path in (package / "msg").glob("*.msg"))
    with contextlib.redirect_stdout(sys.stderr):
        for name in names:
            convert_msg_to_idl(package, package.name, Path("msg") / f"{name}.msg", out / "msg")
    arguments = package / "arguments.json"
    others = ("std_msgs", "builtin_interfaces")
    described = {
        "package_name": package.name,
        "output_dir": str(out),
        "idl_tuples": [f"{out}:msg/{name}.idl" for name in names],
        "include_paths": [f"{other}:{share / other}" for other in others],
    }
    arguments.write_text(json.dumps(described))
    generate_type_hash(str(arguments))
    found = {}
    for name in names:
        answer = json.loads((out / "msg" / f"{name}.json").read_text())
        hashes = {one["type_name"]: one["hash_string"] for one in answer["type_hashes"]}
        type_ = answer["type_description_msg"]["type_description"]
        found[name] = {"hash": hashes[type_["type_name"]], "fields": [field["name"] for field in type_["fields"]]}
    print(json.dumps(found))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))

"""The sample blueprint: the thesis' robot, with every key explained (thesis 4.3)."""

from __future__ import annotations

import shlex
from pathlib import Path

from msbot.config.blueprint.sample_buggy import BUGGY_ROBOT_TOML
from msbot.config.blueprint.sample_rover import ROVER_ROBOT_TOML
from msbot_xrce.errors import ConfigError

SAMPLE_ROBOT_TOML = """\
# The blueprint of a robot: who it is, which parts it has, and who talks to whom.
# Lines that begin with # are comments. Start the robot with:  msbot master robot.toml

[robot]                                    # the profile: what the master publishes about the robot
name = "MSBOT_MASTER"                      # parts look for a robot of this name ...
version = "MSBOT_V1"                       # ... and may insist on a version
serial_number = "X100Y100Z100"
released = "8-4-2021"                      # any text
manufacturer = "MASSEY_ENGINEERING_DEP"

[timing]
preset = "thesis"                          # "thesis": a silent part is delisted after 4 to 6 s; "fast": 1.0 to 1.5 s
# beat_period_s = 1.0                      # a part beats that often
# tick_period_s = 2.0                      # every life status is decremented that often
# life = 3                                 # life status after each beat; at 0 the part is delisted
# profile_period_s = 5.0                   # the profile is repeated that often

[options]
explain = true                             # a refused part is told why; false: silence, as in the thesis
free_topics = []                           # topics that everybody may use without being a part
authentication = "open"                    # "key": each part must prove that it knows its key (`msbot key new`)

# Slots are the roles of the robot. Any part with the right number can fill a slot; the slot keeps its settings and
# its history when the part is replaced.

[[slot]]
name = "AA"
part = "ABCD"                              # part number, a type of the library
local_name = "ABCD-local"                  # optional: decides when several slots take the same part number
description = "Light sensor, 5V"

[[slot]]
name = "BB"
part = "EFGH"
local_name = "EFGH-local"
description = "Toggle switch, 5V"

[[slot]]
name = "CC"
part = "WXYZ"
local_name = "WXYZ-local"
description = "Motor driver, 5V"

# A part type may have parameters (those of the sample have none); a slot sets them in a table right below itself:
# [slot.settings]
# period_s = 0.5

# Bindings are the wires: one publishing port, any number of subscribing ports, written SLOT.port.
# The sample is a ring: AA tells BB, BB tells CC, CC tells AA.

[[binding]]
topic = "HelloWorldTopic_1_to_2"
type = "HelloWorld"                        # message type; the ports must carry the same one
from = "AA.out"
to = ["BB.in"]
reliable = true                            # false: best effort, only the newest sample matters

[[binding]]
topic = "HelloWorldTopic_2_to_3"
type = "HelloWorld"
from = "BB.out"
to = ["CC.in"]

[[binding]]
topic = "HelloWorldTopic_3_to_1"
type = "HelloWorld"
from = "CC.out"
to = ["AA.in"]
"""
"""What `msbot init` writes."""


SAMPLES = {"thesis": SAMPLE_ROBOT_TOML, "rover": ROVER_ROBOT_TOML, "buggy": BUGGY_ROBOT_TOML}
"""The sample blueprints by name."""


def write_sample(path: Path, sample: str = "thesis") -> None:
    """Write a sample blueprint to a new file; raises as `write_new`.

    Args:
        path: the file.
        sample: a name in `SAMPLES`.
    """
    write_new(path, SAMPLES[sample])


def write_new(path: Path, text: str) -> None:
    """Write a text to a new file.

    Raises:
        ConfigError: the file exists (it is never overwritten) or cannot be written.
    """
    try:
        stream = path.open("x", encoding="utf-8")
    except FileExistsError:
        what = "is a directory" if path.is_dir() else "exists already and is not overwritten"
        raise ConfigError(f"{path}: {what}; choose another name, for example {_other_name(path)}") from None
    except FileNotFoundError:
        raise ConfigError(
            f"{path}: there is no folder {path.parent}; create it with `mkdir -p {shlex.quote(str(path.parent))}`"
        ) from None
    except PermissionError:
        raise ConfigError(f"{path}: no permission to write in {path.parent}; choose another folder") from None
    except (OSError, ValueError) as error:
        raise ConfigError(f"{path}: cannot be written ({_reason(error)}); choose another name") from None
    try:
        with stream:
            stream.write(text)
    except OSError as error:
        path.unlink(missing_ok=True)
        raise ConfigError(f"{path}: cannot be written ({_reason(error)}); make room or choose another disk") from None


def _other_name(path: Path) -> Path:
    if path.is_dir():
        return path / "robot.toml"
    number = 2
    while (candidate := path.with_stem(f"{path.stem}{number}")).exists():
        number += 1
    return candidate


def _reason(error: OSError | ValueError) -> str:
    return error.strerror or str(error) if isinstance(error, OSError) else str(error)

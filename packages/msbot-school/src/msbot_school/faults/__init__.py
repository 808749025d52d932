"""The fault lab: faults planted on purpose in a running robot, and missions that ask to find them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_xrce.lazy import lazy_face

if TYPE_CHECKING:
    from msbot_school.faults.kinds import Acts, Amount, FaultKind, PacketFault
    from msbot_school.faults.treatments import PacketTreatment

_NAMES = {
    "msbot_school.faults.kinds": ("Acts", "Amount", "FaultKind", "PacketFault"),
    "msbot_school.faults.treatments": ("PacketTreatment",),
}

__getattr__ = lazy_face(__name__, _NAMES)

__all__ = ["Acts", "Amount", "FaultKind", "PacketFault", "PacketTreatment"]

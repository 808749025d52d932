"""The fault lab: faults planted in a running robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msbot_xrce.lazy import lazy_face

if TYPE_CHECKING:
    from msbot_school.faults.fault_kinds import Amount, FaultKind, InjectionPoint, PacketFault
    from msbot_school.faults.packet_treatments import PacketTreatment

_NAMES = {
    "msbot_school.faults.fault_kinds": ("InjectionPoint", "Amount", "FaultKind", "PacketFault"),
    "msbot_school.faults.packet_treatments": ("PacketTreatment",),
}

__getattr__ = lazy_face(__name__, _NAMES)

__all__ = ["Amount", "FaultKind", "InjectionPoint", "PacketFault", "PacketTreatment"]

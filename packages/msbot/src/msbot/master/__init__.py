"""The composition root: connects agent, inventory, profile and links.

STOP, which outlives the master, is stored here and can be said from here.
"""

from msbot.master.master import Master, StoppableLink, profile_of, timing_of
from msbot.master.robot_as_part import ExportedPort, RobotAsPart, dds_topic_lookup, exported_ports, robot_space
from msbot.master.stop_persistence import StopStore, stop_file
from msbot.master.stop_socket import StopSocket, answer_of

__all__ = [
    "ExportedPort",
    "Master",
    "RobotAsPart",
    "StopSocket",
    "StopStore",
    "StoppableLink",
    "answer_of",
    "dds_topic_lookup",
    "exported_ports",
    "profile_of",
    "robot_space",
    "stop_file",
    "timing_of",
]

"""What every endpoint tells of itself beside its topic and type, as the nodes of ROS 2 read it: `key=value;`.

`rmw_cyclonedds` complains once for each endpoint whose user data are not of that form.
"""

from __future__ import annotations

from msbot_agent.space.dds.ros_type_hashes import ROS_TYPE_HASHES


def user_data_of(type_name: str) -> bytes:
    """The user data of an endpoint: the hash of its type if ROS 2 knows the type, else who made it."""
    found = ROS_TYPE_HASHES.get(type_name)
    return b"vendor=msbot;" if found is None else f"typehash=RIHS01_{found};".encode()

"""OMG IDL and ROS 2 interface files to Python, C or IDL: `msbot idl`."""

from msbot_agent.idl.c_writer import to_c
from msbot_agent.idl.definitions_reader import read_definitions
from msbot_agent.idl.idl_writer import to_idl
from msbot_agent.idl.model import Definitions
from msbot_agent.idl.python_writer import to_python

__all__ = ["Definitions", "read_definitions", "to_c", "to_idl", "to_python"]

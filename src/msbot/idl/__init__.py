"""Message definitions of others: OMG IDL and ROS 2 interface files in, Python, C or IDL out (`msbot idl`)."""

from msbot.idl.c_writer import to_c
from msbot.idl.idl_writer import to_idl
from msbot.idl.model import Definitions
from msbot.idl.python_writer import to_python
from msbot.idl.reader import read_definitions

__all__ = ["Definitions", "read_definitions", "to_c", "to_idl", "to_python"]

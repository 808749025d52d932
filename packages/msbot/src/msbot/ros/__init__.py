"""A robot in ROS 2: parts as nodes, parameters, diagnostics, description, clock.

This module imports nothing, so that an agent without a robot can use `graph` alone: import from the modules themselves.
"""

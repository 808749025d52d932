"""A robot as ROS 2 sees it: its parts as nodes, their parameters, its diagnostics, description and clock.

This module imports nothing, so that an agent without a robot can use `graph` alone: import from the modules themselves.
"""

"""Clients of the agent as ROS 2 nodes: names, graph, parameters."""

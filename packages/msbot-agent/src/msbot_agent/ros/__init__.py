"""Clients of the agent as nodes of ROS 2: names, the graph, parameters of nodes that have none."""

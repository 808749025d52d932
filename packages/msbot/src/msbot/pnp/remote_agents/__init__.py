"""Agents elsewhere whose clients are parts of this robot: the gate at the agent, and the side of the master."""

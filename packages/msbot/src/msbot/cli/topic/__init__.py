"""`msbot topic`: the topics of a running robot, with the habits of `ros2 topic` and `candump`."""

"""The commands that only look: the parts of a robot, why a part is in its state, the robots of a database."""

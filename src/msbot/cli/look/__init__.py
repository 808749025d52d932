"""The commands that only look: the parts of a robot, why a part is as it is, the robots of a database."""

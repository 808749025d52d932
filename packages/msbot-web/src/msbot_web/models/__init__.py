"""What pages and API show of a robot, its bus and a class, as pydantic models."""

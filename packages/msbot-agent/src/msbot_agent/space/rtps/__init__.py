"""DDSI-RTPS 2.3 for the services of ROS 2: a participant of its own, in Python, without I/O but for `driver`."""

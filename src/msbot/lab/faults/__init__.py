"""The fault lab: faults planted on purpose in a running robot, and missions that ask to find them."""

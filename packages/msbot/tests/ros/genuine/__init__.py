"""Tests with genuine nodes of ROS 2."""

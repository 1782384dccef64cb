"""Logs of ROS 1, ROS 2 and MCAP: positions of topics, and of frames by transforms."""

"""MCAP recordings of ROS 2 messages, for Foxglove and ROS 2."""

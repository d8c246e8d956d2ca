"""A SUMO scenario of one's own drives the vehicles; channel and LiDAR of every step go back to it."""

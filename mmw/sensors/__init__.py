"""The agents' sensors and the ground truth about what they see, as plain NumPy arrays for one batch of frames."""

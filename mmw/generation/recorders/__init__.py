"""One batch of frames through every sensor: each module launches one kind and hands its rows over."""

"""Training of a beam-tracking agent in `mmw/BeamTracking-v0`, beside exhaustive search, held beams and positions."""

"""Measure and sample polylines."""

import numpy as np


def arc_length(points: np.ndarray) -> np.ndarray:
    """Return the length of a polyline up to each of its points [m], shape [N]; points have shape [N, K]."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def sample_polyline(points: np.ndarray, along: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the points at stations `at` of a polyline whose points have the stations `along`, shape [len(at), K]."""
    return np.stack([np.interp(at, along, column) for column in points.T], axis=1)

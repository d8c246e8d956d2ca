"""Find the road level of a recorded vehicle: heights under a line, followed from its start where decks overlap."""

import numpy as np

from mmw.traffic.ground_height import DROP_ABOVE, DROP_BELOW, Ground

STEP_UP = 0.35
"""The surface under a line changes by at most this from sample to sample [m]; more is another deck."""

HINT_REACH = 1.5
"""The road is at most this far from the height that a table gives [m]."""


class Decks:
    """All drivable surfaces above each other."""

    def __init__(self, ground: Ground, low: float, high: float) -> None:
        """Look for surfaces between the heights of the lowest and the highest vertex [m]."""
        self.ground = ground
        step = 0.95 * (DROP_ABOVE + DROP_BELOW)  # a little less, so that no height falls between two levels
        self.levels = np.arange(high, low - step, -step)

    def follow(self, line: np.ndarray, first: int, last: int, hint: float) -> tuple[np.ndarray, int]:
        """Return the height of one deck along a line.

        Args:
            line: Places close to each other, seen from above [m], shape [N, 2].
            first: Row where the vehicle starts.
            last: Row up to which it needs a road.
            hint: Height of the road at row `first` [m]; NaN for the highest deck that reaches `last`.

        Returns:
            Heights [m], shape [N], before and after the road as at its ends; and -1, or the first row of `first`..
            `last` without a road (the one that lies farthest along, if there are several decks).
        """
        surface = np.stack([self.ground.heights(np.column_stack([line, np.full(len(line), z)])) for z in self.levels])
        starts = surface[:, first]
        starts = np.unique(starts[np.isfinite(starts)])[::-1]
        if np.isfinite(hint):
            starts = starts[np.abs(starts - hint) <= HINT_REACH]
            starts = starts[np.argsort(np.abs(starts - hint), kind="stable")]
        lost = first
        for start in starts.tolist():
            height = np.full(len(line), np.nan)
            height[first] = start
            for rows in (range(first + 1, len(line)), range(first - 1, -1, -1)):
                before = start
                for row in rows:
                    near = surface[:, row][np.abs(surface[:, row] - before) <= STEP_UP]
                    if not len(near):
                        break
                    before = height[row] = near[np.argmin(np.abs(near - before))]
            known = np.flatnonzero(np.isfinite(height))
            if known[-1] >= last:
                height[: known[0]], height[known[-1] :] = height[known[0]], height[known[-1]]
                return height, -1
            lost = max(lost, int(known[-1]) + 1)
        return np.zeros(len(line)), lost

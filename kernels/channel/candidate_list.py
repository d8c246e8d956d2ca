"""List path candidates on the device: kernels append them in any order, and count those that have no room too."""

import warp as wp

LISTED = wp.constant(0)
"""Entry of the counts: candidates that were appended."""
FOUND = wp.constant(1)
"""Entry of the counts: paths that were found among candidates."""
FULL = wp.constant(2)
"""Entry of the counts: 1 if a candidate of several planes found no cell in its table."""
COUNTS = 3
"""Number of counts, which start as zeros."""


@wp.struct
class CandidateList:
    """Candidate paths: a link and its interactions, from transmitter to receiver."""

    link: wp.array[int]
    """Link of each candidate, in the order of the transmitters, shape [C]."""
    step: wp.array2d[int]
    """Interactions of each: a surface id (or plane id), -2 - wedge id, or -1 behind the end, shape [C, D]."""
    is_plane: wp.array[wp.uint8]
    """1 if the steps are planes, of which the point picks the surface, shape [C]."""


@wp.func
def append_candidate(candidates: CandidateList, link: int, is_plane: bool, counts: wp.array[int]) -> int:
    """Return the row of a new candidate without interactions, -1 if there is no room."""
    row = wp.atomic_add(counts, LISTED, 1)
    if row >= candidates.link.shape[0]:
        return -1
    candidates.link[row] = link
    candidates.is_plane[row] = wp.where(is_plane, wp.uint8(1), wp.uint8(0))
    for k in range(candidates.step.shape[1]):
        candidates.step[row, k] = -1
    return row

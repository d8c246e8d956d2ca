"""Lives of paths against a recording worked out by hand and the memoryless law."""

import numpy as np
import pytest

from mmw.channel.path_table import KEY_TYPE, CarrierPaths
from mmw.channel.path_tracks import PathTracks, tracks_from_rows
from mmw.channel.track_statistics import (
    continues_old_path,
    fine_steps_db,
    level_steps_db,
    median_lifetime,
    sample_rows,
    survival,
)


def tracks_of(rows: list[tuple[int, int, float, float]], frames: int, step: int = 1) -> PathTracks:
    """Return the tracks of one link from rows of frame, path_id, delay [ns] and |a|."""
    rows = sorted(row for row in rows if row[0] % step == 0)
    keys = np.empty(frames // step + (frames % step > 0), dtype=KEY_TYPE)
    for index in range(len(keys)):
        keys[index] = ("town", "sunny", step * index, "cav_1", "rsu_1", "antenna", "antenna")
    frame, name, delay, level = (np.array(column) for column in zip(*rows, strict=True))
    zeros = np.zeros(len(rows))
    paths = CarrierPaths(
        carrier_hz=28e9, keys=keys, link=frame.astype(np.int64) // step, row=np.arange(len(rows)),
        is_los=np.zeros(len(rows), dtype=bool), tau=1e-9 * delay, transfer=np.zeros((len(rows), 2, 2), dtype=complex),
        a=level.astype(complex), theta_t=zeros, phi_t=zeros, theta_r=zeros, phi_r=zeros, doppler_hz=zeros,
        interaction=np.zeros((len(rows), 0), dtype=np.int8), vertex=np.zeros((len(rows), 0, 3)), first_segment_m=zeros,
        edge=np.full((len(rows), 3), np.nan), curvature=np.full((len(rows), 6), np.nan),
    )  # fmt: skip
    return tracks_from_rows(paths, name.astype(np.int64), rate_hz=1000, step=step)


def test_a_recording_by_hand() -> None:
    """Path 1 is there from the start; 2 lives one frame, 3 goes on where 2 was, 4 and 5 outlast the recording."""
    rows = [(f, 1, 100.0, 1.0 + (f == 2)) for f in range(4)]
    rows += [(1, 2, 200.0, 1.0), (2, 3, 200.2, 1.0), (3, 3, 200.4, 0.0), (4, 3, 200.6, 0.0)]
    rows += [(3, 4, 200.4, 1.0), (4, 4, 300.0, 1.0), (5, 4, 300.0, 1.0), (5, 5, 9.0, 1.0)]
    tracks = tracks_of(rows, 6)
    by_name = dict(zip(tracks.path_id, continues_old_path(tracks, 1e-9), strict=True))
    assert by_name == {1: False, 2: False, 3: True, 4: False, 5: False}
    assert not continues_old_path(tracks, 0.1e-9).any()
    # births are 2, 3, 4, 5: of four one ends after a frame; of the two that are known longer, one after three
    np.testing.assert_allclose(survival(tracks), [1.0, 0.75, 0.75, 0.375])
    assert median_lifetime(tracks) == pytest.approx(0.003)
    assert median_lifetime(tracks, tracks.path_id == 5) == np.inf
    assert np.isnan(median_lifetime(tracks, np.zeros(5, dtype=bool)))
    steps = level_steps_db(tracks)
    assert len(steps) == 3 + 0 + 2 + 2 + 0
    np.testing.assert_allclose(steps[:3], [0.0, 20 * np.log10(2), -20 * np.log10(2)])
    assert steps[3] == -np.inf and steps[4] == 0.0


def test_survival_of_a_memoryless_law_does_not_depend_on_the_end() -> None:
    """Paths that die with 10 % a frame: S(n) = 0.9^n, though most are cut off; 4 standard deviations of 3,000."""
    rng = np.random.default_rng(5)
    rows = []
    for name in range(3000):
        begin = 1 + name % 14
        rows += [(f, name, 1.0, 1.0) for f in range(begin, min(begin + rng.geometric(0.1), 15))]
    tracks = tracks_of(rows, 15)
    share = survival(tracks)
    assert tracks.is_death.mean() < 0.6
    np.testing.assert_allclose(share[:11], 0.9 ** np.arange(11), atol=4 * np.sqrt(0.25 / 1000))
    assert median_lifetime(tracks) == pytest.approx(0.007, abs=0.0011)  # 0.9^7 = 0.478


@pytest.mark.parametrize("offset", [0.1, 0.3, 0.5])
def test_a_null_is_no_abrupt_change(offset: float) -> None:
    """An amplitude that falls to 0 and rises at one rate changes by several dB from sample to sample, as a fade."""
    rows = [(f, 1, 100.0, abs(f - 4.0 - offset)) for f in range(11)]
    fine, coarse = tracks_of(rows, 11), tracks_of(rows, 11, step=10)
    assert fine_steps_db(coarse, fine)[0] > 3.0
    assert fine_steps_db(coarse, fine, abrupt=True) == [0.0]


def test_finer_frames_tell_a_fade_from_a_step() -> None:
    """Of three paths that lose 12 dB over ten frames one fades evenly, one steps by 10 dB, one is away for a frame."""
    fade = [10.0 ** (-1.2 * f / 20.0) for f in range(11)]
    step = [10.0 ** (-(0.2 * f + 10.0 * (f > 6)) / 20.0) for f in range(11)]
    rows = [(f, 7, 100.0, level) for f, level in enumerate(fade)] + [(f, 9, 50.0, x) for f, x in enumerate(step)]
    rows += [(f, 8, 100.0, level) for f, level in enumerate(fade) if f != 4]
    rows += [(f, 3, 20.0, 0.0) for f in range(11)] + [(0, 4, 20.0, 1.0)]
    fine, coarse = tracks_of(rows, 11), tracks_of(rows, 11, step=10)
    assert coarse.step_s == pytest.approx(0.01)
    assert coarse.path_id.tolist() == [3, 4, 7, 8, 9]
    np.testing.assert_allclose(level_steps_db(coarse), [0.0, -12.0, -12.0, -12.0])
    np.testing.assert_allclose(fine_steps_db(coarse, fine), [0.0, 1.2, np.inf, 10.2])
    np.testing.assert_allclose(fine_steps_db(coarse, fine, abrupt=True), [0.0, 0.0, np.inf, 10.2])
    every = np.arange(len(coarse))
    frames = fine.frame[sample_rows(fine, coarse, every, np.full(len(coarse), 10))]
    assert frames.tolist()[2:] == [10, 10, 10] and sample_rows(fine, coarse, every[1:2], np.array([10])) == [-1]
    with pytest.raises(ValueError, match="every n-th frame"):
        fine_steps_db(fine, coarse)

"""Edges close to reflected paths are found whether rays meet them or not."""

import numpy as np
import pytest

from mmw.physics.em.interaction import DIFFRACTION, SPECULAR
from mmw.physics.materials.material import RadioMaterial
from tests.fixtures.scenes import box_part
from tests.oracles import channel as oracle

MATERIALS = oracle.radio_materials({"metal": RadioMaterial("itu", itu="itu_pec")})


@pytest.mark.parametrize("is_swapped", [False, True])
def test_a_thin_post_beside_a_reflected_path_is_found_without_rays_on_it(is_swapped: bool, device: str) -> None:
    """A post of 0.2 m stands 30 m and more from both ends, where a thousand rays meet it nowhere; as `exhaustive`."""
    wall = box_part("Buildings/wall", (120.0, 1.0, 12.0), (50.0, 10.5, 6.0), "metal", "building")
    post = box_part("Props/post", (0.2, 0.2, 10.0), (30.0, 6.13, 5.0), "metal", "pole")
    ends = [(0.0, 0.0, 5.0), (100.0, 0.0, 5.2)]
    tx, rx = reversed(ends) if is_swapped else ends
    arrays = oracle.link_scene([wall, post], tx, rx, materials=MATERIALS)
    found = []
    for candidates in ("launch", "exhaustive"):
        config = oracle.channel(
            max_depth=2, diffraction=True, finite_surfaces=True, candidates=candidates, samples_per_tx=1000
        )
        links, paths = oracle.solve(arrays, config, device)
        one_way = np.flatnonzero(links.tx_actor[paths.link] == 0)
        kinds = paths.interaction[one_way]
        both = (kinds == DIFFRACTION).any(axis=1) & (kinds == SPECULAR).any(axis=1)
        own = one_way[both]
        direct = np.linalg.norm(np.subtract(ends[1], ends[0]) * [1, 0, 1] + [0, 20.0, 0])
        close = own[paths.tau[own] * 299792458.0 - direct < 0.2]
        found.append(paths.path_id[close])
        assert len(close) >= 2
    assert set(found[0]) == set(found[1])

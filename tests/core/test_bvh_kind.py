"""Both kinds of trees find the same, and a process has one of them, chosen by the configuration or the environment."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from mmw.config import load_config
from mmw.core import bvh_kind as bvh
from mmw.core.bvh import build_bvhs
from mmw.core.bvh_default import BVH_KINDS, BVH_VARIABLE, default_bvh
from mmw.core.bvh_kind import select_bvh
from mmw.core.errors import InputError
from mmw.core.resources import configs_dir
from mmw.kernels.core import bvh as tree
from tests.fixtures.bvh_rays import all_rays

ROOT = Path(__file__).resolve().parents[2]
FLAT = np.array([[(0, 0, 0), (1, 0, 0), (0, 1, 0)]], np.float32)


def other_kind() -> str:
    return next(kind for kind in BVH_KINDS if kind != default_bvh())


def python(*arguments: str, kind: str) -> subprocess.CompletedProcess[str]:
    """Run Python in a new process whose environment names a kind of trees."""
    environment = {**os.environ, BVH_VARIABLE: kind, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    return subprocess.run([sys.executable, *arguments], env=environment, cwd=ROOT, capture_output=True, text=True)


def test_both_kinds_find_the_same(device: str, tmp_path: Path) -> None:
    here = all_rays(device)
    done = python("-m", "tests.fixtures.bvh_rays", device, str(tmp_path / "there.npz"), kind=other_kind())
    assert done.returncode == 0, done.stderr
    there = np.load(tmp_path / "there.npz")
    assert list(here) == there.files
    ray_count = hit_count = 0
    for name, found in here.items():
        other = there[name]
        ray_count += len(found)
        hit_count += int((found[:, 1] >= 0).sum())
        if name.startswith("outline"):
            # Rounding decides whether these meet a thing, but not where: up to 30 % of them pass it in one kind alone.
            is_met = (found[:, 1] >= 0) & (other[:, 1] == found[:, 1])
            assert is_met.mean() > 0.3 and (found[:, 1] != other[:, 1]).mean() < 0.3, name
            # As below: a GPU's compiler fuses, so what starts on a surface 12 m from the origin may meet it 2e-6 m on.
            rtol, atol = (1e-6, 1e-6) if device == "cpu" else (1e-5, 1e-4)
            np.testing.assert_allclose(found[is_met, 0], other[is_met, 0], rtol=rtol, atol=atol, err_msg=name)
        elif device == "cpu":
            np.testing.assert_array_equal(found, other, err_msg=name)
        else:  # a GPU rounds a product in a sum or not, as its compiler likes: ties may go elsewhere
            np.testing.assert_array_equal(found[:, 1] >= 0, other[:, 1] >= 0, err_msg=name)
            np.testing.assert_allclose(found[:, 0], other[:, 0], rtol=1e-5, atol=1e-4, err_msg=name)
    assert ray_count > 150_000 and hit_count > 80_000


@pytest.mark.slow
@pytest.mark.parametrize("kind", BVH_KINDS)
def test_kernels_hold_the_code_of_one_kind(kind: str, tmp_path: Path) -> None:
    """Neither native code nor flags of ours are in kernels for Warp's trees, whenever they were imported."""
    script = f"""
import warp as wp
wp.config.kernel_cache_dir = {str(tmp_path)!r}
from mmw.kernels.lidar import trace as lidar
from mmw.core.bvh_kind import select_bvh
for kind in {("warp", "wide", kind)!r}:  # until there is a tree, the last one counts
    select_bvh(kind)
import numpy as np
from mmw.kernels.core import mesh_rays
from mmw.kernels.camera import rain_streaks as streaks
from mmw.kernels.radar import trace as radar
from mmw.core.bvh import RayMesh
mesh = RayMesh(np.eye(3), np.array([[0, 1, 2]]))
assert mesh.cast(np.zeros((1, 3)), np.full(3, 3**-0.5), 9.0)[1][0] == 0
flags = {{wp.get_module(m.__name__).options["cpu_compiler_flags"] for m in (lidar, radar, streaks)}}
print(len(flags), None in flags)
"""
    done = python("-c", script, kind="wide")
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[-2:] == (["1", "True"] if kind == "warp" else ["2", "False"])
    (source,) = tmp_path.rglob("*rays*.cpp")
    code = source.read_text()
    assert ("ext_vector_type" in code) == (kind == "wide")
    assert ("mesh_query_ray" in code) == (kind == "warp")


def test_the_kind_stays_once_there_is_a_tree() -> None:
    trees, roots = build_bvhs([FLAT, FLAT], "cpu")
    np.testing.assert_array_equal(len(trees.meshes) > 0, bvh.kind_to_build() == "warp")
    select_bvh(bvh.kind_to_build())
    was = bool(tree.WIDE)
    with pytest.raises(InputError, match=r"has built a BVH of kind .* start a new process"):
        select_bvh(next(kind for kind in BVH_KINDS if kind != bvh.kind_to_build()))
    assert was == bool(tree.WIDE) and len(roots) == 2


def test_warps_trees_live_as_long_as_the_array_of_their_ids() -> None:
    script = """
import gc, weakref
import numpy as np, warp as wp
from mmw.kernels.core.structs import Scene
from mmw.core.bvh import build_bvhs
made = []
Mesh = wp.Mesh
def watched(**arguments):
    mesh = Mesh(**arguments)
    made.append(weakref.ref(mesh))
    return mesh
wp.Mesh = watched
scene = Scene()
scene.tree, _ = build_bvhs([np.eye(3, dtype=np.float32)[None]], "cpu")
gc.collect()
assert made[0]() is not None
del scene
gc.collect()
assert made[0]() is None
"""
    done = python("-c", script, kind="warp")
    assert done.returncode == 0, done.stderr


def test_configuration_and_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    quickstart = configs_dir() / "quickstart.yaml"
    for name, expected in (("wide", "wide"), ("warp", "warp"), ("", "wide")):
        monkeypatch.setenv(BVH_VARIABLE, name)
        assert load_config(quickstart).compute.bvh == expected
        assert load_config(quickstart, ["compute.bvh=wide"]).compute.bvh == "wide"
    identity = {load_config(quickstart, [f"compute.bvh={kind}"]).sha256() for kind in BVH_KINDS}
    assert len(identity) == 1
    monkeypatch.setenv(BVH_VARIABLE, "own")
    with pytest.raises(InputError, match=r"MMW_BVH = 'own' in the environment; set it to wide or warp, or unset it"):
        load_config(quickstart)
    with pytest.raises(InputError, match=r"compute\.bvh = 'own'; give wide or warp"):
        select_bvh("own")


def test_warp_takes_a_changed_constant_into_the_hash() -> None:
    module = wp.get_module("mmw.kernels.core.mesh_rays")
    wide = bool(tree.WIDE)
    hashes = []
    try:
        for value in (wide, not wide, wide):
            tree.WIDE = value
            wp.set_module_options({}, module="mmw.kernels.core.mesh_rays")
            hashes.append(module.get_module_hash())
    finally:
        tree.WIDE = wide
        wp.set_module_options({}, module="mmw.kernels.core.mesh_rays")
    assert hashes[0] == hashes[2] != hashes[1]

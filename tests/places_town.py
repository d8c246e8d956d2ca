"""A small town with one of every place, and sloping or level ground, for tests of what stands in a town."""

from dataclasses import replace

import numpy as np

from mmw.town import solids
from mmw.town.ground import Ground
from mmw.town.parts import MeshPart
from mmw.town.solids import Mesh

PLACES = """
name: places
profiles:
  street: {lanes: 1, width: 3.5, shoulder: 0.6, walk: 2.0}
  parking: {lanes: 1, width: 3.5, shoulder: 2.5, walk: 2.0}
  aisle: {lanes: 1, width: 3.0, shoulder: 0.3, kerb_height: 0, kerb_width: 0, walk: 0, verge: 0}
  drive: {lanes: 1, width: 3.5, shoulder: 0.5, kerb_height: 0, kerb_width: 0, walk: 0, verge: 0, oneway: true}
nodes:
  A: [-110, -90, 0]
  E: [0, -90, 0]
  G1: [38, -90, 0]
  G2: [92, -90, 0]
  B: [130, -90, 0]
  C: [130, 90, 0]
  F: [0, 90, 0]
  D: [-110, 90, 0]
  J1: [0, 30, 0]
  J2: [0, -30, 0]
  K1: [-35, 30, 0]
  K2: [-35, -30, 0]
roads:
  - {id: south_w, from: A, to: E, profile: parking, priority: 2}
  - {id: south_m, from: E, to: G1, profile: street, priority: 2}
  - {id: south_g, from: G1, to: G2, profile: street, priority: 2}
  - {id: south_e, from: G2, to: B, profile: street, priority: 2}
  - {id: east, from: B, to: C, profile: street}
  - {id: north_e, from: C, to: F, profile: street, priority: 2}
  - {id: north_w, from: F, to: D, profile: street, priority: 2}
  - {id: west, from: D, to: A, profile: street}
  - {id: mid_n, from: F, to: J1, profile: street, priority: 2}
  - {id: mid_m, from: J1, to: J2, profile: street, priority: 2}
  - {id: mid_s, from: J2, to: E, profile: street, priority: 2}
  - {id: a1, from: J1, to: K1, profile: aisle, speed: 4}
  - {id: a2, from: J2, to: K2, profile: aisle, speed: 4}
  - {id: a3, from: K1, to: K2, profile: aisle, speed: 4}
  - {id: a4, from: K1, to: K2, profile: aisle, speed: 4, via: [[-75, 30, 9], [-75, -30, 9]]}
  - {id: gas, from: G1, to: G2, profile: drive, speed: 4, via: [[38, -62, 9], [92, -62, 9]]}
blocks:
  seed: 5
  styles:
    tower: {facade: metal_fascia, glass: glass_facade, door: metal_fascia, windows: curtain, mullion_m: 0.12,
      bay_m: 3.2, storeys: [9, 12], storey_m: 3.8, ground_storey_m: 5.5, sill_m: 0.3, head_m: 0.3, front_m: [22, 28],
      depth_m: [20, 24], podium_storeys: 2, plant_room: true, plans: [rectangle, corner_cut, l_shape]}
    flats: {facade: brick_facade, storeys: [4, 6], balconies: true, shop_front: true, bay_m: 4.2, window_fraction: 0.42,
      plans: [rectangle, l_shape]}
    farmhouse: {facade: brick_facade, roof: tile_roof, roof_form: gable, storeys: [2, 2], storey_m: 2.9,
      ground_storey_m: 3.0, front_m: [12, 16], depth_m: [9, 11], gap_m: 8, setback_m: 7, head_m: 0.5}
  districts:
    - {name: core, center: [40, 60], radius_m: 60, styles: {tower: 1}}
    - {name: flats, center: [-60, 90], radius_m: 80, styles: {flats: 1}}
    - {name: farms, center: [60, -130], radius_m: 60, styles: {farmhouse: 1}, coverage: 0.5}
buildings:
  - {name: hall_west, style: flats, center: [-24, 62], size_m: [20, 20], yaw_deg: 0, storeys: 5}
  - {name: hall_south, style: flats, center: [-24, 44], size_m: [16, 20], yaw_deg: 0, storeys: 4}
skybridges:
  - {name: sky_a, from: [-14, 62], to: [11, 62], width: 8, soffit: 6.5}
  - {name: sky_b, from: [-11, -60], to: [12, -58], width: 25, soffit: 7, storeys: 2, bay_m: 2.5}
lots:
  - {name: lot, at: [-55, 0], rows: 4, aisle_m: 6, bay: [2.5, 5.0], occupied: 0.7, seed: 2}
bays:
  - {along: south_w, side: right, from: 12, to: 72, occupied: 0.7}
  - {along: south_w, side: left, from: 20, to: 60, occupied: 0.5, seed: 3}
paved:
  - {name: forecourt, outline: [[41, -79], [89, -79], [89, -42], [41, -42]], material: concrete_sidewalk}
props:
  placed:
    - {kind: gas_canopy, at: [65, -62], yaw_deg: 270}
    - {kind: gas_shop, at: [65, -47], yaw_deg: 270}
    - {kind: price_sign, at: [45, -80.5], yaw_deg: 0}
    - {kind: silo, at: [40, -10], yaw_deg: 180}
    - {kind: silo, at: [40, -17.5], yaw_deg: 180}
    - {kind: silo, at: [40, -25], yaw_deg: 180}
    - {kind: barn, at: [60, 5], yaw_deg: 180}
    - {kind: wooden_barn, at: [60, -20], yaw_deg: 90}
    - {kind: hay_bales, at: [48, -8], yaw_deg: 30}
    - {kind: water_tower, at: [85, 10]}
    - {kind: advertising_column, at: [9.5, 20]}
    - {kind: planter, at: [9.5, 15]}
    - {kind: cycle_rack, at: [9.5, 10]}
  lines:
    - {kind: field_fence, points: [[25, 20], [95, 20], [95, -32], [25, -32]]}
    - {kind: guard_rail, points: [[140, -60], [140, -20]]}
    - {kind: hedge, points: [[-95, -50], [-20, -50]]}
  rows:
    - {kind: street_lamp, every_m: 30, offset_m: 0.65, clear_m: 1.2}
    - {kind: bench, every_m: 40, offset_m: 1.9, clear_m: 1.2, along: ["mid_*"]}
    - {kind: broadleaf_tree, every_m: 15, offset_m: 4.6, clear_m: 2.6}
  fences: true
  scattered_trees: 40
"""
"""Description of the town, as the text of its YAML file."""


SLOPE = np.array([0.03, -0.02])


def sheet(size: float = 100.0, step: float = 7.0, bump: float = 0.0) -> MeshPart:
    """Return a sloping square of terrain about the origin, optionally uneven."""
    count = int(2 * size / step) + 1
    x, y = np.meshgrid(*2 * [np.linspace(-size, size, count)], indexing="ij")
    z = SLOPE[0] * x + SLOPE[1] * y + bump * np.sin(0.13 * x) * np.cos(0.17 * y)
    k = np.arange(count * count).reshape(count, count)
    corners = np.stack([k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]], axis=-1).reshape(-1, 4)
    points = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    return MeshPart("Terrain/block_00", *solids.quads(points, corners), "grass", "terrain")


def plan_area(mesh: Mesh | MeshPart) -> float:
    a, b, c = (mesh.points[mesh.faces[:, k], :2] for k in range(3))
    u, v = b - a, c - a
    return float(0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum())


LEVEL = Ground([replace(sheet(), points=sheet().points * [1, 1, 0])])
"""Level ground at height 0."""

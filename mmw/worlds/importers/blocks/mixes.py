"""Mixes of buildings and furniture for imported roads: `city`, `suburb`, or a YAML file of one's own."""

from pathlib import Path

from mmw.config.yaml_file import read_yaml, validated
from mmw.core.errors import InputError
from mmw.worlds.towns.block_description import (
    BlockDescription,
    BlocksSection,
    BuildingStyle,
    District,
    PropRow,
    PropsSection,
)

WHOLE = 40_000.0
"""Radius of a district that holds every world [m]: twice the largest extent."""

CITY = {
    "glass_office": BuildingStyle(
        facade="metal_fascia", glass="glass_facade", door="metal_fascia", windows="curtain", storeys=(6, 10),
        storey_m=3.8, ground_storey_m=5.0, sill_m=0.3, head_m=0.3, bay_m=5.6, mullion_m=0.12, plant_room=True,
        plans=("rectangle", "corner_cut"), front_m=(20, 30), depth_m=(14, 20), gap_m=4, setback_m=4.5,
    ),
    "concrete_office": BuildingStyle(
        facade="concrete_facade", door="metal_fascia", windows="ribbon", storeys=(4, 7), bay_m=14, sill_m=1.0,
        head_m=0.7, plans=("rectangle", "corner_cut"), front_m=(16, 28), depth_m=(12, 16), gap_m=3, setback_m=4,
    ),
    "shops": BuildingStyle(
        facade="marble_facade", storeys=(3, 5), bay_m=6.6, shop_front=True, front_m=(13, 22), depth_m=(10, 14),
        gap_m=2, setback_m=3.2,
    ),
    "brick_flats": BuildingStyle(
        facade="brick_facade", storeys=(3, 6), storey_m=3.1, bay_m=7.0, balconies=True,
        plans=("rectangle", "l_shape"), front_m=(15, 26), depth_m=(10, 13), gap_m=4, setback_m=4,
    ),
}  # fmt: skip
"""Styles of `city`."""
SUBURB = {
    "brick_house": BuildingStyle(
        facade="brick_facade", roof="tile_roof", roof_form="gable", storeys=(1, 2), storey_m=2.9, ground_storey_m=2.9,
        bay_m=3.2, window_fraction=0.4, head_m=0.5, front_m=(9, 13), depth_m=(8, 10), gap_m=6, setback_m=5,
    ),
    "hip_house": BuildingStyle(
        facade="brick_facade", roof="tile_roof", roof_form="hip", storeys=(1, 2), storey_m=2.9, ground_storey_m=3.0,
        bay_m=3.2, window_fraction=0.42, head_m=0.5, pitch=0.6, front_m=(10, 14), depth_m=(9, 11), gap_m=7,
        setback_m=5,
    ),
    "concrete_flats": BuildingStyle(
        facade="concrete_facade", storeys=(2, 4), storey_m=3.0, bay_m=5.5, balconies=True, front_m=(16, 24),
        depth_m=(10, 12), gap_m=8, setback_m=6,
    ),
}  # fmt: skip
"""Styles of `suburb`."""

MIXES = {
    "city": BlockDescription(
        blocks=BlocksSection(
            styles=CITY,
            districts=(
                District(
                    name="whole", center=(0.0, 0.0), radius_m=WHOLE, coverage=0.95,
                    styles={"glass_office": 1, "concrete_office": 2, "shops": 2, "brick_flats": 2},
                ),
            ),
        ),
        props=PropsSection(
            crown_detail=2,
            rows=(
                PropRow(kind="street_lamp", every_m=35, offset_m=0.6, clear_m=1.2),
                PropRow(kind="broadleaf_tree", every_m=20, offset_m=1.5, clear_m=2.2, start_m=8, jitter_m=2),
                PropRow(kind="bench", every_m=90, offset_m=1.6, clear_m=1.2, start_m=14),
                PropRow(kind="litter_bin", every_m=90, offset_m=1.5, clear_m=1.0, start_m=16.5),
            ),
        ),
    ),
    "suburb": BlockDescription(
        blocks=BlocksSection(
            styles=SUBURB,
            districts=(
                District(
                    name="whole", center=(0.0, 0.0), radius_m=WHOLE, coverage=0.9,
                    styles={"brick_house": 3, "hip_house": 2, "concrete_flats": 1},
                ),
            ),
        ),
        props=PropsSection(
            crown_detail=2,
            fences=True,
            rows=(
                PropRow(kind="street_lamp", every_m=45, offset_m=0.6, clear_m=1.2),
                PropRow(kind="broadleaf_tree", every_m=24, offset_m=4.0, clear_m=2.2, start_m=8, jitter_m=4),
            ),
        ),
    ),
}  # fmt: skip
"""Name -> buildings and furniture. Weights of the styles, sizes and distances are design values; storeys are drawn
evenly between the fewest and the most of a style."""


def load_mix(name: str, seed: int | None) -> BlockDescription:
    """Return a mix by name, or from a YAML file with the sections `blocks`, `buildings` and `props` of a town.

    Args:
        name: Key of `MIXES`, or path of a file.
        seed: Seed of sizes, styles and scatter; None keeps that of the mix.

    Raises:
        InputError: If there is neither a mix nor a file of this name, the file is wrong, or has sections that imported
            roads cannot have.
    """
    if name in MIXES:
        mix = MIXES[name]
    elif Path(name).suffix in (".yaml", ".yml"):
        mix = validated(BlockDescription, read_yaml(Path(name), "a map with blocks and props"), Path(name))
        given = [key for key in ("skybridges", "lots", "bays", "paved", "weather") if key in mix.model_fields_set]
        if given:
            raise InputError(f"{name}: {given[0]}: goes only with roads from a town's YAML; remove the section")
    else:
        raise InputError(f"--buildings {name!r}: is no mix; give {', '.join(MIXES)} or a YAML file")
    if seed is None:
        return mix
    return mix.model_copy(update={"blocks": mix.blocks.model_copy(update={"seed": seed})})

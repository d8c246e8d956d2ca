"""The schema and the material library: authored values, USD validation, and what sensors read."""

import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdShade

import mmw
from mmw.core.resources import assets_dir
from mmw.physics.em.scattering import lobe_integral
from mmw.physics.materials.layers import Layer
from mmw.physics.materials.material import (
    LIDAR_REFLECTANCE_905NM,
    MAX_LOBE_EXPONENT,
    Material,
    RadioMaterial,
    lidar_reflectance,
)
from mmw.usd import schema
from mmw.usd.material_library import LIBRARY, NONVISUAL, PAINTS, MaterialSpec
from mmw.usd.materials import read_material, resolve_material
from mmw.usd.prim_values import decimal
from mmw.usd.validate import validate_stage
from mmw.worlds.materials.library import build_materials, write_material
from tests.fixtures.radio_materials import WRONG_RADIO

SHIPPED = assets_dir() / "materials" / "materials.usda"

PAPER_ROWS = {
    "marble_facade": "itu_marble", "concrete_roof": "itu_concrete", "tile_roof": "itu_concrete",
    "glass_facade": "itu_glass", "brick_facade": "itu_brick", "asphalt": "itu_very_dry_ground",
    "grass": "itu_medium_dry_ground", "car_paint_red": "itu_metal", "traffic_light_metal": "itu_metal",
}  # fmt: skip


@pytest.fixture(scope="module")
def shipped() -> Usd.Stage:
    return Usd.Stage.Open(str(SHIPPED))


def test_schema_applies_to_materials_only_and_resolves_fallbacks():
    code = (  # in a process of its own: the table of USD schemas is built once a process
        "from mmw.usd.schema import RADIO_API, RADIO_ATTRIBUTES, register\n"
        "register(); register()\n"
        "from pxr import Usd, UsdShade\n"
        "stage = Usd.Stage.CreateInMemory()\n"
        "material = UsdShade.Material.Define(stage, '/material').GetPrim()\n"
        "mesh = stage.DefinePrim('/mesh', 'Mesh')\n"
        "api = Usd.SchemaRegistry.GetTypeFromName(RADIO_API)\n"
        "print(*(bool(prim.CanApplyAPI(api)) for prim in (material, mesh)))\n"
        "print(material.ApplyAPI(RADIO_API), material.HasAPI(RADIO_API))\n"
        "names = {a.name for a in RADIO_ATTRIBUTES.values()}\n"
        "print(names <= set(material.GetPropertyNames()))\n"
        "print(material.GetAttribute('mmw:radio:relativePermittivity').Get())\n"
    )
    root = Path(mmw.__file__).parents[1]
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root)
    assert done.stdout.split() == ["True", "False", "True", "True", "True", "1.0"]


def test_library_holds_every_name_once_and_validates():
    stage = Usd.Stage.Open(str(SHIPPED))
    assert sorted(prim.GetName() for prim in stage.GetDefaultPrim().GetChildren()) == sorted(LIBRARY)
    assert validate_stage(stage) == []


@pytest.mark.slow
def test_rebuild_equals_the_committed_library(tmp_path):
    build_materials(tmp_path / "materials.usda")
    assert (tmp_path / "materials.usda").read_bytes() == SHIPPED.read_bytes()


@pytest.mark.parametrize("name", LIBRARY)
def test_every_value_is_authored(shipped, name):
    prim = shipped.GetPrimAtPath(f"/Materials/{name}")
    assert prim.GetPrimTypeInfo().GetAppliedAPISchemas() == [schema.RADIO_API]
    for attribute in (a for a in schema.RADIO_ATTRIBUTES.values() if not a.is_optional):
        assert prim.GetAttribute(attribute.name).HasAuthoredValue(), attribute.name
        assert prim.GetAttribute(attribute.name).GetTypeName() == attribute.type_name
    model, row = prim.GetAttribute("mmw:radio:model").Get(), prim.GetAttribute("mmw:radio:itu").Get()
    assert (model == "itu") == row.startswith("itu_") and model in ("itu", "constant")
    assert prim.GetAttribute(f"{NONVISUAL}base").Get() in LIDAR_REFLECTANCE_905NM
    assert prim.GetAttribute(f"{NONVISUAL}coating").Get() in ("none", "paint", "clearcoat", "paint_clearcoat")
    shader = UsdShade.Material(prim).ComputeSurfaceSource()[0]
    assert shader.GetIdAttr().Get() == "UsdPreviewSurface"
    assert all(0.0 <= channel <= 1.0 for channel in shader.GetInput("diffuseColor").Get())


@pytest.mark.parametrize(("name", "row"), PAPER_ROWS.items())
def test_radio_rows_are_those_of_the_paper(shipped, name, row):
    assert shipped.GetPrimAtPath(f"/Materials/{name}").GetAttribute("mmw:radio:itu").Get() == row


def test_authored_numbers_read_back(tmp_path):
    stage = Usd.Stage.CreateNew(str(tmp_path / "one.usda"))
    radio = RadioMaterial(
        "constant", relative_permittivity=4.5, conductivity=0.25, thickness=0.125, scattering=0.5, xpd=0.75,
        scattering_pattern="backscattering", alpha_r=3, alpha_i=2, lobe_share=0.75, medium="foliage", rms_height=0.0005,
        layers=("itu_glass 0.004", Layer.sheet(5.0), Layer(relative_permittivity=1.5, thickness=0.016)),
    )  # fmt: skip
    material = write_material(stage, "/Slab", MaterialSpec(radio, "plastic", (0.5, 0.25, 0.125), 0.5))
    read = {name: material.GetPrim().GetAttribute(a.name).Get() for name, a in schema.RADIO_ATTRIBUTES.items()}
    assert RadioMaterial(**read | {"rms_height": decimal(read["rms_height"])}) == radio
    assert material.GetPrim().GetAttribute("mmw:radio:model").GetVariability() == Sdf.VariabilityUniform
    assert read_material(stage, resolve_material("", material.GetPrim())).radio == radio


@pytest.mark.parametrize(
    ("changes", "needed"),
    [*WRONG_RADIO, *(({"model": model}, "itu or constant") for model in ("measured", "function"))],
)
def test_wrong_radio_attributes_are_refused_with_their_place(changes: dict, needed: str) -> None:
    stage = Usd.Stage.CreateInMemory()
    material = write_material(stage, "/Wall", MaterialSpec(RadioMaterial("constant"), "brick", (0.5, 0.5, 0.5), 0.5))
    for name, value in changes.items():
        attribute = schema.RADIO_ATTRIBUTES[name]
        material.GetPrim().CreateAttribute(attribute.name, attribute.type_name).Set(value)
    use = resolve_material("", material.GetPrim())
    name, value = list(changes.items())[-1]
    message = f"/Wall: {schema.RADIO_ATTRIBUTES[name].name} = {value!r}; {needed} is needed; correct the attribute"
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        read_material(stage, use)


def test_the_sharpest_lobe_has_an_integral() -> None:
    assert np.isfinite(lobe_integral(MAX_LOBE_EXPONENT, np.array([0.0, 0.5, 1.0]))).all()


@pytest.mark.parametrize("value", [-0.1, math.nan])
def test_a_wrong_reflectance_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match=f"material 'snow': lidar_reflectance = {value:g}; a finite number from 0"):
        Material("snow", RadioMaterial("constant"), "none", value, (1.0, 1.0, 1.0))


def test_paint_decides_lidar_reflectance():
    reflectance = {p: _reflectance(f"car_paint_{p}") for p in PAINTS}
    assert reflectance["black"] < 0.1 < reflectance["green"] < reflectance["red"] < reflectance["white"] < 0.8
    assert lidar_reflectance("asphalt") == LIDAR_REFLECTANCE_905NM["asphalt"]
    assert lidar_reflectance("aluminum", "paint", ("retroreflective",)) == LIDAR_REFLECTANCE_905NM["retroreflective"]
    assert lidar_reflectance("steel", "paint", (), (0, 0, 0)) == 0.05
    assert lidar_reflectance("steel", "paint", (), (0, 1, 0)) == pytest.approx(0.80)


def _reflectance(name: str) -> float:
    spec = LIBRARY[name]
    return lidar_reflectance(spec.base, spec.coating, spec.attributes, spec.color)


def test_unknown_base_token_says_which_are_known():
    with pytest.raises(ValueError, match=r"'chocolate'.*asphalt"):
        lidar_reflectance("chocolate")


def test_validation_names_the_prim_that_is_wrong():
    stage = Usd.Stage.CreateInMemory()
    stage.DefinePrim("/part", "Xform").CreateRelationship("material:binding").AddTarget("/nowhere")
    findings = validate_stage(stage)
    assert any("/part" in line and "MissingMaterialBindingAPI" in line for line in findings)
    assert any("upAxis" in line for line in findings)

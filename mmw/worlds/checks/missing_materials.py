"""Check that every mesh has a radio material, a visual material and a class."""

from collections import Counter
from collections.abc import Mapping

from pxr import Usd, UsdShade

from mmw.core.errors import InputError
from mmw.usd.material_entries import entry_of, find_pattern
from mmw.usd.materials import read_material, resolve_material
from mmw.worlds.checks.findings import Finding
from mmw.worlds.checks.stage_model import StageMesh, StageModel


def material_findings(model: StageModel, material_map: Mapping[str, str]) -> list[Finding]:
    """Return every mesh prim that lacks something; a prototype is named once, at its first use."""
    uses = Counter(part.source for part in model.parts)
    found, seen = [], set()
    for part in model.parts:
        if part.source in seen:
            continue
        seen.add(part.source)
        more = f" ({uses[part.source]} uses)" if uses[part.source] > 1 else ""
        for material in part.materials:
            bound = f"material {material.GetPath()}" if material else "no material is bound"
            for severity, rule, text, cure in _missing_properties(model.stage, part, material, material_map):
                found.append(Finding(severity, rule, part.path, f"{text} ({bound}){more}", cure))
        if part.label == "unlabeled":
            cure = "apply SemanticsLabelsAPI:class with a class of docs/concepts/conventions.md"
            found.append(Finding("warning", "label", part.path, f"no semantic class{more}", cure))
    return found


def _missing_properties(
    stage: Usd.Stage,
    part: StageMesh,
    material: Usd.Prim | None,
    material_map: Mapping[str, str],
) -> list[tuple]:
    found = []
    try:
        pattern = find_pattern(material_map, part.path, material.GetName() if material else "", label=part.label)
        use = resolve_material(part.label, material, entry_of(material_map, pattern), pattern)
        if use is None:
            cure = "author mmw:radio:* on its material, or map it: --material-map 'PATH=itu_concrete'"
            found.append(("error", "radio_material", "no radio material", cure))
        else:
            read_material(stage, use)
    except InputError as error:
        found.append(("error", "radio_material", str(error), "correct the material"))
    general = UsdShade.MaterialBindingAPI(part.prim).ComputeBoundMaterial()[0]
    if not any(_is_shown(shown) for shown in (UsdShade.Material(material) if material else None, general)):
        cure = "bind a material with a UsdPreviewSurface; pictures show it gray otherwise"
        found.append(("warning", "visual_material", "no UsdPreviewSurface", cure))
    return found


def _is_shown(material: UsdShade.Material | None) -> bool:
    shader = material.ComputeSurfaceSource()[0] if material else None
    return bool(shader) and shader.GetShaderId() == "UsdPreviewSurface"

"""Write actor prims: role, model, box, class, and an instance of the model's asset."""

from pxr import Gf, Sdf

from mmw.usd.prim_specs import new_prim, set_label, set_value
from mmw.usd.vehicle_catalog import ActorModel


def describe_actor(prim: Sdf.PrimSpec, role: str, model: ActorModel, asset: str, paint: str) -> None:
    """Write the attributes `mmw:actor:*` and the class of an actor, and its `Model`."""
    types = Sdf.ValueTypeNames
    set_value(prim, "mmw:actor:role", types.Token, role)
    set_value(prim, "mmw:actor:model", types.String, model.name)
    set_value(prim, "mmw:actor:size", types.Float3, Gf.Vec3f(model.length, model.width, model.height))
    set_value(prim, "mmw:actor:center", types.Float3, Gf.Vec3f(*model.center))
    set_label(prim, model.label)
    body = new_prim(prim.layer, prim.path.AppendChild("Model"), "Xform")
    body.referenceList.Prepend(Sdf.Reference(asset))
    body.variantSelections["paint"] = paint
    body.instanceable = True

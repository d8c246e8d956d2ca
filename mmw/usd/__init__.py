"""Write and read USD prims: schema, materials, semantics, meshes."""

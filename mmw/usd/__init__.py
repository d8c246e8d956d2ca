"""What mmw writes into and reads from USD prims: schema, materials, semantics, meshes. Leftmost in the data flow."""

"""Name paths by a hash of their ends and interactions, and find what these are on."""

import warp as wp

from mmw.kernels.channel.path_geometry import DIFFUSE
from mmw.kernels.channel.segments import DIFFRACTION, SPECULAR, TRANSMISSION
from mmw.kernels.core.compiler import AS_NUMPY

wp.set_module_options(AS_NUMPY)


@wp.func
def mixed(value: wp.uint64, word: wp.int64) -> wp.uint64:
    """Return a hash with one more word in it. Source: the finaliser of SplitMix64, G. L. Steele et al., OOPSLA 2014."""
    z = (value ^ wp.uint64(word)) + wp.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> wp.uint64(30))) * wp.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> wp.uint64(27))) * wp.uint64(0x94D049BB133111EB)
    return z ^ (z >> wp.uint64(31))


@wp.struct
class NamedSurfaces:
    """The G surfaces and W wedges of a scene."""

    wall: wp.array[int]
    """Surface that names all of one plane or curved surface, shape [G]."""
    object_id: wp.array[int]
    """Object of each surface, shape [G]."""
    material_id: wp.array[int]
    """Material of each surface, shape [G]."""
    owner: wp.array[int]
    """Instance that each surface is part of, -1 for the town, shape [G]."""
    line: wp.array[int]
    """Wedge that names all of one line of edges, shape [W]."""
    face: wp.array[int]
    """First face of each wedge, a surface, shape [W]."""


@wp.struct
class MetSurfaces:
    """Ends and interactions of P paths."""

    tx: wp.array[wp.int64]
    """Number of the transmitting antenna of each link, shape [L]."""
    rx: wp.array[wp.int64]
    """Number of the receiving antenna, shape [L]."""
    link: wp.array[int]
    """Link of each path, shape [P]."""
    kind: wp.array2d[int]
    """Kind of each interaction, 0 behind the last, shape [P, D]."""
    surface: wp.array2d[int]
    """Surface of each interaction, of a diffraction its wedge, shape [P, D]."""
    ray: wp.array[int]
    """Ray of a diffuse path, shape [P]."""
    batch_index: wp.array[int]
    """Position of the frame of each link in the batch, shape [L]."""
    actor: wp.array[int]
    """Actor that each instance belongs to, shape [V]."""


@wp.struct
class PathNames:
    """Names of P paths and of what their interactions are on, as `mmw.channel.path_solver.path_names.PathNames`."""

    path_id: wp.array[wp.int64]
    kind: wp.array[wp.int8]
    object_id: wp.array2d[int]
    material_id: wp.array2d[int]
    body: wp.array2d[int]


@wp.kernel
def path_name_kernel(paths: MetSurfaces, surfaces: NamedSurfaces, actors: int, names_out: PathNames):
    """Write 63 bits that transmitter, receiver and the interactions of each path give, the kind of the path, a row of
    `mmw.channel.paths.PATH_KINDS`, and what each interaction is on: its object, its material, and its body, which is
    batch index times `actors` plus the actor. Launch: dim=(P,).
    """
    path = wp.tid()
    value = mixed(mixed(wp.uint64(0), paths.tx[paths.link[path]]), paths.rx[paths.link[path]])
    highest = wp.int32(0)
    for step in range(paths.kind.shape[1]):
        code = paths.kind[path, step]
        own = paths.surface[path, step]
        of_object = wp.int32(-1)
        material = wp.int32(-1)
        body = wp.int32(-1)
        if code != 0:
            face = wp.int32(own)
            name = wp.int32(own)
            if code == DIFFRACTION:
                face = surfaces.face[own]
                name = surfaces.line[own]
                highest = wp.max(highest, 4)
            elif code == SPECULAR:
                name = surfaces.wall[own]
                highest = wp.max(highest, 1)
            elif code == TRANSMISSION:
                name = surfaces.object_id[own]
                highest = wp.max(highest, 2)
            elif code == DIFFUSE:
                name = paths.ray[path]
                highest = wp.max(highest, 3)
            of_object = surfaces.object_id[face]
            material = surfaces.material_id[face]
            if surfaces.owner[face] >= 0:
                body = paths.batch_index[paths.link[path]] * actors + paths.actor[surfaces.owner[face]]
            value = mixed(mixed(value, wp.int64(code)), wp.int64(name))
        names_out.object_id[path, step] = of_object
        names_out.material_id[path, step] = material
        names_out.body[path, step] = body
    names_out.path_id[path] = wp.int64(value >> wp.uint64(1))
    names_out.kind[path] = wp.int8(highest)


@wp.kernel
def numbered_id_kernel(own: wp.array[wp.int64], number: wp.array[wp.int64], id_out: wp.array[wp.int64]):
    """Write identifiers that a number tells apart; those of number 0 stay. Launch: dim=(P,)."""
    path = wp.tid()
    id_out[path] = own[path]
    if number[path] != wp.int64(0):
        id_out[path] = wp.int64(mixed(wp.uint64(own[path]), number[path]) >> wp.uint64(1))

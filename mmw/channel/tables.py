"""Describe the tables of the radio channel: the geometry of paths once, their gains for every weather and carrier."""

import pyarrow as pa

from mmw.storage.table_spec import (
    AGENT,
    F32,
    F64,
    FRAME,
    I8,
    I32,
    I64,
    NAME,
    OWNED,
    SCENARIO,
    TableSpec,
    ViewSpec,
    column,
    list_of,
)

ENDS = (
    column("peer", NAME, "", "transmitter of the link; `agent` is the receiver"),
    column("antenna", NAME, "", "antenna of `agent`, a sensor of `sensors`"),
    column("peer_antenna", NAME, "", "antenna of `peer`, a sensor of `sensors`"),
)
CARRIER = (
    column("carrier", I8, "index", "number of the carrier in the configuration, from 0"),
    column("carrier_hz", F64, "Hz", "carrier frequency"),
)
LINK_KEY = ("frame", "agent", "peer", "antenna", "peer_antenna", "carrier")
PARTS = (("re", "real"), ("im", "imaginary"))
FIELDS = {"t": "theta (zenith)", "p": "phi (azimuth)"}
WITHOUT_PHASE = "antenna patterns included, exp(-j 2 pi f tau) not"
NO_PATH = "; null where the link has no path"

LINKS = TableSpec(
    "links",
    "One radio link at one carrier; a link without any path has a row that says so.",
    (
        *OWNED,
        *ENDS,
        *CARRIER,
        column("link", NAME, "", "name of its rule in `channel.links`, such as v2i (from an RSU to a CAV)"),
        column("path_count", I32, "count", "paths found, 0 or more"),
        column("is_los", pa.bool_(), "", "true if there is a line of sight: it is free, or passes only foliage"),
        column("los_state", NAME, "", "clear, foliage (the line of sight passes crowns of trees) or blocked"),
        column("gain_db", F64, "dB", "10 log10 of the sum of |a|^2 over the paths" + NO_PATH, nullable=True),
        column("mean_delay_s", F64, "s", "mean of tau weighted by |a|^2" + NO_PATH, nullable=True),
        column("rms_delay_s", F64, "s", "standard deviation of tau weighted by |a|^2" + NO_PATH, nullable=True),
        column(
            "doppler_spread_hz", F64, "Hz", "standard deviation of Doppler weighted by |a|^2" + NO_PATH, nullable=True
        ),
    ),
    LINK_KEY,
)

PATH = column("path", I32, "index", "number of the path in its link, from 0; equal for all carriers and weathers")
DESCRIPTION = (
    column("path_id", I64, "id", "the same in every frame, carrier and weather; a diffuse path lives in one frame"),
    column("kind", NAME, "", "los, specular, transmission, diffuse or diffraction: the last of these on its way"),
    column("order", I8, "count", "interactions on the way"),
    column("tau_s", F64, "s", "absolute delay: path length over the speed of light"),
)
ANGLES = (
    column("aod_az", F64, "rad", "azimuth of departure from `peer`, world frame, -pi to pi"),
    column("aod_ze", F64, "rad", "zenith angle of departure from `peer`, world frame, 0 to pi"),
    column("aoa_az", F64, "rad", "azimuth of arrival at `agent`, towards the last vertex, world frame, -pi to pi"),
    column("aoa_ze", F64, "rad", "zenith angle of arrival at `agent`, towards the last vertex, world frame, 0 to pi"),
)
RANGE_RATE = column("range_rate", F64, "m/s", "rate of the path's length; positive while the path gets longer")
DOPPLER = column("doppler_hz", F64, "Hz", "Doppler shift, -range_rate carrier_hz / c; positive while it gets shorter")
INTERACTIONS = (
    column("interactions", list_of(I8), "-", "each interaction: 1 specular, 2 diffuse, 4 transmission, 8 diffraction"),
    column("vertices", list_of(F64), "m", "x, y, z of each interaction in turn, from `peer` to `agent`, world frame"),
    column("objects", list_of(I32), "id", "object of each interaction, a row of `objects`"),
    column("materials", list_of(I32), "id", "material of each interaction, a row of `materials`"),
    column(
        "surfaces", list_of(I32), "id", "surface (of a diffraction: edge) of each interaction, the same in every frame"
    ),
    column("first_segment_m", F64, "m", "length from `peer` to the first vertex; of a line of sight, the whole path"),
    column("edge", list_of(F64), "-", "x, y, z of the unit vector along the edge that diffracts, world frame"),
    column(
        "curvature",
        list_of(F64),
        "1/m",
        "xx, xy, xz, yy, yz, zz of the curvature of a curved surface that reflects, a "
        "symmetric matrix over its tangent plane, positive where it bends away from the ends, world frame",
    ),
)
TRANSFER = (
    *(column(f"a_{part}", F64, "-", f"{word} part of the coefficient, {WITHOUT_PHASE}") for part, word in PARTS),
    *(
        column(
            f"t_{to}{of}_{part}",
            F64,
            "-",
            f"{word} part of the transfer from the {FIELDS[of]} field at departure "
            f"to the {FIELDS[to]} field at arrival, antenna patterns and exp(-j 2 pi f tau) not included",
        )
        for to, of in ("tt", "tp", "pt", "pp")
        for part, word in PARTS
    ),
)
LOSSES = tuple(
    column(f"{name}_db", F32, "dB", f"loss by {word} that a and t hold; 10^(dB/20) times them is without it")
    for name, word in (("rain", "rain"), ("fog", "fog"), ("gas", "oxygen and water vapor"), ("foliage", "foliage"))
)

PATH_GEOMETRY = TableSpec(
    "path_geometry",
    "One propagation path of one radio link: its geometry, the same in every weather and at every carrier.",
    (SCENARIO, FRAME, AGENT, *ENDS, PATH, *DESCRIPTION, *ANGLES, RANGE_RATE, *INTERACTIONS),
    (*LINK_KEY[:-1], "path"),
    by_weather=False,
    unique=(*LINK_KEY[:-1], "path_id"),
)

PATH_GAINS = TableSpec(
    "path_gains",
    "The gains of one propagation path at one carrier in one weather; its geometry is in `path_geometry`.",
    (*OWNED, *ENDS, *CARRIER, PATH, *TRANSFER, *LOSSES),
    (*LINK_KEY, "path"),
)

PATHS = ViewSpec(
    "paths",
    "One propagation path of one radio link at one carrier in one weather: `path_gains` with the columns of its "
    "`path_geometry`, and the Doppler shift.",
    (*OWNED, *ENDS, *CARRIER, PATH, *DESCRIPTION, *TRANSFER, *ANGLES, DOPPLER, *LOSSES, *INTERACTIONS),
    (*LINK_KEY, "path"),
    ("path_gains", "path_geometry"),
)

TABLES = (LINKS, PATH_GEOMETRY, PATH_GAINS)
"""Tables of the radio channel."""

VIEWS = (PATHS,)
"""Views of the radio channel."""

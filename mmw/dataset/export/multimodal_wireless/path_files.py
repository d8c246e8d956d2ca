"""Channel files of the published Multimodal-Wireless dataset: one `.npz` a link and frame, as its Sionna script wrote.

    a                                   complex64 [1, 1, Nr, 1, Nt, M, 1], carrier phase included
    tau                                 float32 [1, 1, 1, M] [s]
    theta_t, phi_t, theta_r, phi_r      float32 [1, 1, 1, M], zenith and azimuth in the arrays' frames [rad]
    glob_theta_t, ... glob_phi_r        the same in the world's frame

A link without any path has M = 1, gain 0, delay -1 and angles 0, which is how Sionna pads; the published script stopped
at such a frame. Antennas are counted as Sionna counts them (`mmw.channel.PlanarArray`).

The published files have plane waves over their arrays, as Sionna RT's synthetic arrays (`wavefront=plane`); those
written here have spherical ones where plane waves would be wrong by more than pi / 8. The published files set the first
path of each link to delay 0 before any phase is formed (`delays=normalized`): the time of flight is lost, and the phase
of the link with it. `delays=absolute` has both. Their angles in the arrays' frames have pitch with the wrong sign and
no roll; those written here are correct.

Source: Multimodal-Wireless, `Sionna_channel_storage/channel_storage_v2i.py`, `channel_storage_v2v.py`, `data_utils.py`.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mmw.channel import LINK_COLUMNS, CarrierPaths, PlanarArray, apply_arrays, impulse_response
from mmw.core.errors import InputError
from mmw.core.transforms import quaternion_to_matrix
from mmw.dataset import Dataset
from mmw.dataset.export.exporter import VEHICLE_ROLES, Options, Part
from mmw.dataset.export.read_radio import Antennas, read_antennas
from mmw.dataset.export.read_sensors import Block
from mmw.dataset.table_reader import path_columns

ARRAYS = re.compile(r"([1-9]\d*)x([1-9]\d*)-([1-9]\d*)x([1-9]\d*)")
"""Rows x columns of the transmitter, then of the receiver."""


@dataclass(frozen=True)
class ArrayPair:
    """Arrays of both ends."""

    tx: PlanarArray
    rx: PlanarArray

    def folder(self, carrier_hz: float) -> str:
        """Return the name of the folder, `Nt_64_Nr_16_fc_28GHz` for linear and `Nt_8x8_...` for planar arrays."""
        sizes = [
            f"{array.num_cols}" if array.num_rows == 1 else f"{array.num_rows}x{array.num_cols}"
            for array in (self.tx, self.rx)
        ]
        return f"Nt_{sizes[0]}_Nr_{sizes[1]}_fc_{carrier_hz / 1e9:g}GHz"


def array_pairs(options: Options) -> list[ArrayPair]:
    """Return the arrays that the option `arrays` names.

    Raises:
        InputError: If it cannot be read.
    """
    pairs = []
    for text in options["arrays"].split(","):
        found = ARRAYS.fullmatch(text.strip())
        if found is None:
            raise InputError(
                f"v1: arrays={options['arrays']}: {text!r} is no pair of arrays; give rows x columns of transmitter "
                "and receiver, such as 1x64-1x16,8x8-8x8"
            )
        sizes = [int(size) for size in found.groups()]
        arrays = [
            PlanarArray(rows, columns, pattern=options["pattern"], polarization=options["polarization"])
            for rows, columns in (sizes[:2], sizes[2:])
        ]
        pairs.append(ArrayPair(*arrays))
    return pairs


def write_channels(dataset: Dataset, part: Part, folder: str, options: Options, out: Path) -> None:
    """Write the files of every link and frame of a part, at every carrier, for every pair of arrays."""
    antennas = read_antennas(dataset, part)
    block = Block(dataset, part.scenario, part.weather, part.frames)
    rows, links = block.table("paths", path_columns(dataset)), block.table("links", LINK_COLUMNS)
    pairs = array_pairs(options)
    roles = {agent: role for (_, agent), role in zip(antennas.row, antennas.role, strict=True)}
    rsus = {agent for agent, role in roles.items() if role == "rsu"}
    for carrier in np.unique(links["carrier_hz"].to_numpy()):
        paths = CarrierPaths.from_table(rows, float(carrier), links)
        for number in range(paths.link_count):
            link = paths.take([number])
            frame, agent, peer = (link.keys[0][name] for name in ("frame", "agent", "peer"))
            if agent not in part.agents or roles[peer] not in VEHICLE_ROLES:
                continue
            # The published scenarios have one roadside unit, which their folders do not name.
            link_folder = agent if peer == min(rsus, default="") else f"{peer}/{agent}"
            for pair in pairs:
                place = out / folder / pair.folder(float(carrier)) / link_folder
                place.mkdir(parents=True, exist_ok=True)
                values = link_arrays(link, antennas, pair, options)
                np.savez_compressed(place / f"{frame:06d}_paths.npz", **values)


def link_arrays(link: CarrierPaths, antennas: Antennas, pair: ArrayPair, options: Options) -> dict[str, np.ndarray]:
    """Return the arrays of the file of one link; normalized delays count from the first path, phases too."""
    frame = int(link.keys["frame"][0])
    turns = [
        quaternion_to_matrix(antennas.at([(frame, str(link.keys[end][0]))])[0][0, 3:]) for end in ("peer", "agent")
    ]
    coefficients = apply_arrays(link, pair.tx, pair.rx, link.carrier_hz, *turns, wavefront=options["wavefront"])
    normalize = options["delays"] == "normalized"
    if len(link):
        gains, tau = impulse_response(coefficients, link, link.carrier_hz, normalize_delays=normalize)
    else:
        gains = np.zeros((1, pair.rx.antenna_count, pair.tx.antenna_count, 1))
        tau = np.full((1, 1), -1.0)
    values = {"a": gains[:, None, :, None, :, :, None].astype(np.complex64), "tau": tau}
    for end, turn, theta, phi in (("t", turns[0], link.theta_t, link.phi_t), ("r", turns[1], link.theta_r, link.phi_r)):
        direction = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1) @ turn
        values[f"theta_{end}"] = np.arctan2(np.hypot(direction[:, 0], direction[:, 1]), direction[:, 2])
        values[f"phi_{end}"] = np.arctan2(direction[:, 1], direction[:, 0])
        values |= {f"glob_theta_{end}": theta, f"glob_phi_{end}": phi}
    for name in values.keys() - {"a"}:
        full = values[name].ravel() if len(values[name]) else np.zeros(1)
        values[name] = full.astype(np.float32)[None, None, None, :]
    return values

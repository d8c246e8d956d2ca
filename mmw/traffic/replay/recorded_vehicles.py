"""Replay vehicles of a trajectory table, each with a model, a paint and a role."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from mmw.core.constants import FRAME_DT
from mmw.core.errors import InputError
from mmw.traffic.demand import TrafficDemand, TrafficResult, VehicleTrack
from mmw.traffic.model_choice import draw_models, draw_paint
from mmw.traffic.replay.poses import LONGEST_GAP, replay
from mmw.traffic.replay.road_level import Decks
from mmw.traffic.replay.trajectory_table import Trajectory, read_trajectories
from mmw.traffic.spawn import name_vehicle, seeded
from mmw.traffic.vehicle_pose import Shape

SAME_TIME = 1e-6
"""Times that differ by no more are the same [s]; float64 seconds since 1970 resolve a quarter of this."""

MAX_NAMED = 5
"""Vehicles that one note names."""


def replay_table(demand: TrafficDemand) -> TrafficResult:
    """Return the motion of recorded vehicles; frame 0 is the earliest time in the table `trajectories`.

    At most `vehicle_count` vehicles appear: those nearest to `spawn_center_m`, and all of `cav_ids`, which are the
    CAVs; where it is empty, `cav_ranks` gives their ranks. The seed draws models and paints that the table leaves open.
    A vehicle other than a CAV that cannot be replayed is left out with a note, and the next nearest takes its place.

    Returns:
        Tracks in the order of `cav_ids` or `cav_ranks`, then by distance.

    Raises:
        InputError: If the file cannot be read, or a CAV is not in it, not there in all frames, or cannot be replayed.
    """
    traffic, frame_count = demand.traffic, demand.frame_count
    path = demand.base / (traffic.trajectories or "")
    try:
        recording = read_trajectories(path, demand.town.georeference)
        ranked = _rank(recording.vehicles, traffic.spawn_center_m, frame_count)
        cavs = _choose_cavs(ranked, traffic.cav_ids, traffic.cav_ranks)
        for cav in cavs:
            _check_presence(cav, frame_count)
        ids = {cav.id for cav in cavs}
        rest = [vehicle for vehicle in ranked if vehicle.id not in ids]
        skipped: dict[str, str] = {}
        count = max(traffic.vehicle_count, len(cavs))
        tracks = place_vehicles(demand, [*cavs, *rest], len(cavs), count=count, skipped=skipped)
        notes = [*recording.notes, *_skipped_note(path, skipped)]
        return TrafficResult(tracks, notes=notes)
    except InputError as error:
        text = str(error).removeprefix(f"{path}: ")
        raise InputError(f"trajectories = {path.name!r}: {text}") from None


def _skipped_note(path: Path, skipped: Mapping[str, str]) -> list[str]:
    """Return a note on the vehicles that could not be replayed."""
    if not skipped:
        return []
    named = ", ".join(map(repr, list(skipped)[:MAX_NAMED])) + (", ..." if len(skipped) > MAX_NAMED else "")
    first = next(iter(skipped.values()))
    return [f"{path.name}: vehicles left out, for they cannot be replayed: {len(skipped)}, {named}; the first: {first}"]


def place_vehicles(
    demand: TrafficDemand,
    vehicles: Sequence[Trajectory],
    cav_count: int,
    comfort: float = np.inf,
    count: int | None = None,
    skipped: dict[str, str] | None = None,
) -> list[VehicleTrack]:
    """Return the tracks of trajectories, CAVs first, without vehicles that are in no frame.

    Args:
        demand: The traffic that is needed.
        vehicles: Trajectories, those of CAVs first.
        cav_count: How many are CAVs.
        comfort: As in `replay`.
        count: Largest number of vehicles; all if None.
        skipped: Receives id and reason of vehicles that cannot be replayed, other than CAVs; None if that is an error.

    Raises:
        InputError: If a vehicle cannot be replayed, or none is there in any frame.
    """
    town = demand.town
    heights = town.points[np.unique(town.faces), 2]
    decks = Decks(demand.ground, float(heights.min()), float(heights.max()))
    tracks: list[VehicleTrack] = []
    placed = 0  # those that are in no frame count too
    for number, vehicle in enumerate(vehicles):
        if count is not None and placed >= count:
            break
        name, role = name_vehicle(len(tracks), cav_count)
        # the id is the key, so that other vehicles of the file change nothing
        generator = seeded(demand.seed, *vehicle.id.encode())
        shape = choose_model(vehicle, demand, role == "cav", generator)
        paint = draw_paint(demand.catalog[shape.name], generator)
        try:
            poses = replay(vehicle, shape, decks, demand.frame_count, comfort)
        except InputError as error:
            if skipped is None or number < cav_count:
                raise
            skipped[vehicle.id] = str(error)
            continue
        placed += 1
        if np.isfinite(poses).any():
            tracks.append(VehicleTrack(name, role, shape.name, paint, poses))
    if not tracks and skipped:
        raise InputError(next(iter(skipped.values())))
    if not tracks:
        raise InputError(
            f"no vehicle is there in the first {demand.frame_count * FRAME_DT:.2f} s; at least one is needed; give "
            "samples there, time counts from the earliest one"
        )
    return tracks


def choose_model(vehicle: Trajectory, demand: TrafficDemand, is_cav: bool, generator: np.random.Generator) -> Shape:
    """Return the model of a recorded vehicle.

    The type counts first: a model's name, or a class label (`car`, `truck`, `bus`) that narrows the choice. Then the
    length: the nearest one. A vehicle without either is drawn, as in generated traffic; a type that is unknown here
    (SUMO files have types of their own) is drawn among the cars.
    """
    shapes = demand.shapes
    for shape in shapes:
        if shape.name == vehicle.type:
            return shape
    labels = {shape.name: demand.catalog[shape.name].label for shape in shapes}
    some = [shape for shape in shapes if labels[shape.name] == vehicle.type] or list(shapes)
    if vehicle.length > 0.0:
        return min(some, key=lambda shape: (_misfit(shape, vehicle), shape.name))
    if vehicle.type and len(some) == len(shapes):
        some = [shape for shape in shapes if labels[shape.name] == "car"] or some
    return draw_models(some, is_cav, generator)[0]


def _misfit(shape: Shape, vehicle: Trajectory) -> float:
    """Return by how much a model differs from the size of a vehicle, as far as the table gives it [m]."""
    aside = abs(2.0 * shape.half_width - vehicle.width) if vehicle.width > 0.0 else 0.0
    return abs(shape.length - vehicle.length) + aside


def _rank(found: Sequence[Trajectory], center: Sequence[float], frame_count: int) -> list[Trajectory]:
    """Return the vehicles that are there in some frame by distance to a center: at frame 0, then those that come later.

    Equal distances are ordered by id.
    """
    end = (frame_count - 1) * FRAME_DT

    def key(vehicle: Trajectory) -> tuple[bool, float, str]:
        x, y = vehicle.points[0]
        return vehicle.time[0] > SAME_TIME, float(np.hypot(x - center[0], y - center[1])), vehicle.id

    return sorted((vehicle for vehicle in found if len(vehicle.time) > 1 and vehicle.time[0] <= end), key=key)


def _choose_cavs(ranked: Sequence[Trajectory], ids: Sequence[str], ranks: Sequence[int]) -> list[Trajectory]:
    by_id = {vehicle.id: vehicle for vehicle in ranked}
    for name in ids:
        if name not in by_id:
            some = ", ".join(list(by_id)[:12]) + (", ..." if len(by_id) > 12 else "")
            raise InputError(f"cav_ids holds {name!r}: the file has {len(by_id)} vehicles: {some}; name one of them")
    if ids:
        return [by_id[name] for name in ids]
    for rank in ranks:
        if rank >= len(ranked):
            raise InputError(
                f"cav_ranks holds {rank}: the file has {len(ranked)} vehicles; use ranks from 0 to {len(ranked) - 1}"
            )
    return [ranked[rank] for rank in ranks]


def _check_presence(cav: Trajectory, frame_count: int) -> None:
    end = (frame_count - 1) * FRAME_DT
    inside = cav.time[(cav.time >= 0.0) & (cav.time <= end)]
    gap = np.diff(cav.time)
    wide = np.flatnonzero((gap > LONGEST_GAP) & (cav.time[:-1] < end))
    if cav.time[0] > SAME_TIME or cav.time[-1] < end - SAME_TIME:
        found = f"is there from {cav.time[0]:.2f} to {cav.time[-1]:.2f} s"
    elif len(wide):
        found = f"has no samples from {cav.time[wide[0]]:.2f} to {cav.time[wide[0] + 1]:.2f} s"
    else:
        return
    raise InputError(
        f"CAV {cav.id!r} {found} after the earliest sample of the file ({len(inside)} samples); CAVs are there in all "
        f"frames, one more than frames.count, 0 to {end:.2f} s; choose another vehicle, or fewer frames"
    )

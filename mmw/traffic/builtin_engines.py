"""Specs of the traffic engines of mmw; imports none of them."""

from mmw.config.traffic_engine import TrafficEngineSpec

IDM = TrafficEngineSpec(
    "intelligent driver model",
    "mmw.traffic.idm.simulation:simulate_idm",
    keys=("cav_pool", "cav_models", "warmup_s", "lane_changes", "signals", "driving_weather"),
    live="mmw.traffic.live.idm_vehicles:IdmVehicles",
)

SUMO = TrafficEngineSpec(
    "SUMO",
    "mmw.traffic.sumo.simulation:simulate_sumo",
    keys=("cav_pool", "cav_models", "warmup_s", "lane_changes", "driving_weather"),
    package="libsumo",
    live="mmw.traffic.sumo.live_vehicles:SumoVehicles",
)

REPLAY = TrafficEngineSpec(
    "table of trajectories",
    "mmw.traffic.replay.recorded_vehicles:replay_table",
    keys=("trajectories", "cav_ids"),
    required=("trajectories",),
    needs_lanes=False,
)

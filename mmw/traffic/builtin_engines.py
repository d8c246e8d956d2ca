"""Specs of the traffic engines of mmw; imports none of them."""

from mmw.config.traffic_engine import TrafficEngineSpec

IDM = TrafficEngineSpec(
    "intelligent driver model",
    "mmw.traffic.idm.simulation:simulate_idm",
    keys=("cav_pool", "cav_models", "warmup_s", "lane_changes", "signals", "driving_weather"),
    start="mmw.traffic.idm.simulation:start_idm",
)

SUMO = TrafficEngineSpec(
    "SUMO",
    "mmw.traffic.sumo.simulation:simulate_sumo",
    keys=("cav_pool", "cav_models", "warmup_s", "lane_changes", "driving_weather"),
    package="libsumo",
)

REPLAY = TrafficEngineSpec(
    "table of trajectories",
    "mmw.traffic.replay.recorded_vehicles:replay_table",
    keys=("trajectories", "cav_ids"),
    required=("trajectories",),
    needs_lanes=False,
)

"""Use the public API as a user would: what `test_user_types.py` checks in pyright's strict mode."""

from pathlib import Path

import numpy as np

import mmw
from mmw.channel import CarrierPaths, PatternTable, apply_arrays, frequency_response, ula
from mmw.channel.statistics import path_loss_db, rms_delay_spread
from mmw.dataset import BeamSearch
from mmw.dataset.camera_geometry import from_world
from mmw.dataset.windows import Feature, WindowSpec, open_windows, split_windows, stream_batches
from mmw.torch import WindowDataset, WindowStream, collate
from mmw.viz.plots import plot_link, render_frame


def trace() -> np.ndarray:
    """Place devices, solve paths, and form channels."""
    scene = mmw.load_scene("town03", weather="rainy", device="cpu")
    transmitter = scene.add(mmw.Transmitter("bs", position=(13.5, -29.5, 10.0), power_dbm=30.0))
    receiver = scene.add(mmw.Receiver("ue", position=np.array([45.0, 90.0, 1.5]), velocity=(10.0, 0.0, 0.0)))
    transmitter.look_at(receiver.position)
    scene.tx_array = mmw.PlanarArray(num_rows=4, num_cols=8, pattern="tr38901", polarization="cross")
    paths = mmw.PathSolver(max_depth=3, diffraction=True)(scene, carriers_hz=[4.9e9, 28e9])
    strongest = paths.select(rx="ue", kind=["los", "specular"]).sort_by_gain(28e9)[:5]
    print(strongest.kind.tolist(), strongest.tau.max(), strongest.gain_db.shape, strongest.tx_names)
    h = paths.cfr(mmw.channel.subcarrier_frequencies(64, 120e3), carrier_hz=28e9, num_time_steps=14)
    a, tau = paths.cir(carrier_hz=28e9)
    by_weather = mmw.PathSolver()(scene, weathers=["rainy"])
    print(a.shape, tau.shape, [len(found) for found in by_weather.values()])
    print(paths.taps(100e6, l_max=64, carrier_hz=28e9).shape, rms_delay_spread(paths.at_carrier(28e9)))
    books = mmw.channel.dft_codebook(scene.tx_array, (4, 8)), mmw.channel.dft_codebook(ula(1), 1)
    best = mmw.channel.best_beams(mmw.channel.beam_gains(h[0, :, 0, :, 0][None], *books))
    print(best.tx_beam.tolist())
    return h


def cover() -> np.ndarray:
    """Compute a radio map, and receivers in it."""
    scene = mmw.load_scene("town03")
    scene.add(mmw.Transmitter("bs", (13.5, -29.5, 10.0)))
    solver = mmw.RadioMapSolver(max_depth=2, samples_per_tx=1_000_000)
    radio_map = solver(scene, carrier_hz=28e9, surface="roads", cell_size_m=2.0)
    values, share = radio_map.cdf("sinr", "bs")
    print(radio_map.rss_dbm.shape, radio_map.tx_association.tolist(), values.max(), share.min())
    return radio_map.sample_positions(10, min_value_db=-90.0)


def generate() -> mmw.Dataset:
    """Generate a dataset, and replay the same frames in memory."""
    traffic = mmw.config.TrafficConfig(vehicle_count=5, spawn_center_m=(0.0, 0.0, 0.0), cav_ranks=(0,))
    config = mmw.Config(
        scenarios=(mmw.config.ScenarioConfig(name="empty", town="town03", traffic=traffic),),
        sensors=(mmw.sensors.Lidar(channels=16),),
        frames=mmw.config.FramesConfig(count=2),
    )
    with mmw.Simulation(config, device="cpu") as simulation:
        for frame in simulation:
            print(frame.frame, frame.time_s, list(frame.agents), len(simulation))
    return mmw.generate(config, out="out/empty", workers=1, progress=False)


def change() -> None:
    """Read and change what is in a scene."""
    config = mmw.load_config("quickstart", ["frames.count=20"])
    with mmw.load_scene(config, weather=["sunny", "rainy"]) as scene:
        scene.frame = 10
        car = scene.actors["cav_1"]
        car.position = (2.0, 45.0, 0.1)
        print(scene.bounds[1] - scene.bounds[0], list(scene.materials), list(scene.objects), len(scene.frames))
        hits = scene.cast_rays([[0.0, 0.0, 10.0]], [[0.0, 0.0, -1.0]], max_distance=50.0)
        print(hits.distance[0], hits.object_id.tolist(), hits.normal.shape)
        cloud = scene.capture(mmw.sensors.Lidar(), actor="cav_1")
        images = scene.capture(mmw.sensors.RgbCamera(), pose=(0.0, 0.0, 5.0, 0.0, 0.0, 0.0, 1.0), weather=["rainy"])
        print(cloud.xyz.shape, images["rainy"].rgb.shape)


def read(folder: str) -> np.ndarray:
    """Read a dataset as frames, paths and tables."""
    data = mmw.open_dataset(folder)
    print(data.tables, data.info["schema_version"], data.numpy("poses")["x"].mean())
    paths: CarrierPaths = data.paths(28e9, frames=range(2))
    a = apply_arrays(paths, ula(64), ula(16), 28e9)
    h = frequency_response(a, paths, mmw.channel.subcarrier_frequencies(64, 120e3), 28e9)
    frame: mmw.Frame = data.frame("town03_roundabout", "sunny", 0)
    for name, agent in frame.agents.items():
        cloud, view = agent.sweeps["lidar"], agent.views["front"]
        print(name, agent.role, from_world(agent.pose, cloud.world).shape, cloud["intensity"].max())
        if view.rgb is not None:
            print(view.rgb.shape, view.camera.is_inside(view.camera.pixels(cloud.world)).sum())
        for link in agent.links:
            print(link.peer, link.carrier_hz, link.gain_db, [link.vertices(path) for path in range(len(link.a))])
    print(mmw.connect(folder, search=BeamSearch(tx_beams=32)).sql("SELECT 1").fetchall(), path_loss_db(paths).max())
    figures = render_frame(data, "town", "sunny", 0), plot_link(data, "town", "sunny", "rsu_1", "cav_1")
    print([figure.get_figwidth() for figure in figures])
    return h


def learn(folder: Path) -> None:
    """Cut windows, as arrays and as tensors."""
    spec = WindowSpec(["poses", Feature("beams", span="future", carrier_hz=28e9)], past=2, future=1)
    windows = open_windows(folder, spec, agents=["cav"])
    parts = split_windows(windows, by="track", parts={"train": 0.8, "test": 0.2})
    for batch in stream_batches(parts["train"], 8):
        print(batch["poses"].shape, windows[0]["now"])
    for batch in WindowStream(parts["train"], batch_size=8):
        print(batch["poses"].shape)
    print(collate([WindowDataset(parts["test"])[0]])["poses"].shape)


def configure() -> None:
    """Describe sensors and antennas, and meet an error."""
    lidar = mmw.sensors.Lidar(channels=64, range_m=120.0)
    camera = mmw.sensors.RgbCamera(width_px=640, height_px=480, fov_deg=90.0)
    others = [mmw.sensors.Imu(), mmw.sensors.Gnss(rate_hz=10.0), mmw.sensors.Radar(), mmw.sensors.DepthCamera()]
    channel = mmw.config.ChannelConfig(carriers_hz=(28e9,), max_depth=2)
    print([sensor.name for sensor in others], channel.max_depth, mmw.config.FramesConfig(count=20).count)
    theta, phi = np.linspace(0.0, np.pi, 19), np.linspace(0.0, 2 * np.pi, 37)
    print(lidar.channels, camera.name, PatternTable(theta, phi, np.ones((19, 37))).theta)
    try:
        mmw.open("nowhere")
    except mmw.InputError as error:
        print(error.problems)

"""Scenes that are read and changed from Python: against arrays made in code, and against rays."""

import gc

import numpy as np
import pytest

import mmw
from mmw.core.errors import InputError
from mmw.core.kinematics import differentiate
from mmw.physics.materials.material import RadioMaterial
from mmw.physics.weather.weather import PRESETS
from mmw.scene.scene import Scene
from tests.fixtures.scenes import arrays_from_parts, box_mesh, box_part, ground_part, two_cars


def street(frames: int = 4, frame: int | None = None) -> Scene:
    return Scene(two_cars(frames), {"sunny": PRESETS["sunny"]}, device="cpu", frame=frame, name="street")


def room() -> Scene:
    """Return a level square and two closed boxes on it, of concrete and of brick."""
    parts = [
        ground_part(),
        box_part("Buildings/house", (4.0, 4.0, 6.0), (10.0, 0.0, 3.0), "concrete_facade", "building"),
        box_part("Buildings/shed", (2.0, 2.0, 2.0), (-10.0, 0.0, 1.0), "brick_facade", "building"),
    ]
    return Scene(arrays_from_parts(parts), {"sunny": PRESETS["sunny"]}, device="cpu")


def down(scene: Scene, x: float, y: float) -> tuple[float, str]:
    """Return the height of the first surface below a place, and its object."""
    hits = scene.cast_rays((x, y, 50.0), (0.0, 0.0, -2.0))
    return 50.0 - float(hits.distance[0]), scene.arrays.objects[hits.object_id[0]].prim_path.rpartition("/")[2]


def test_what_is_in_a_scene() -> None:
    scene = street()
    assert list(scene.actors) == ["cav_1", "veh_001", "rsu_1"] and scene.frames == range(4) and scene.frame == 0
    assert {"street", "north", "south", "cav_1"} <= set(scene.objects) and "asphalt" in scene.materials
    np.testing.assert_array_equal(scene.bounds, [[-100, -10, 0], [100, 10, 15]])
    car = scene.actors["cav_1"]
    assert (car.role, car.label, car.is_static, car.is_present) == ("cav", "car", False, True)
    np.testing.assert_allclose(car.size, (4.5, 1.8, 1.5))
    assert scene.objects["north"].is_static and scene.objects["north"].material == "marble_facade"
    assert "street" in repr(scene) and "cav_1" in repr(car) and "asphalt" in repr(scene.materials["asphalt"])


def test_frames_move_the_actors_of_a_recording() -> None:
    scene = street()
    car = scene.actors["cav_1"]
    for frame in range(4):
        scene.frame = frame
        assert car.position.tolist() == [-20.0 + frame, -3.0, 0.0]
        assert down(scene, -20.0 + frame, -3.0) == (pytest.approx(1.5, abs=1e-5), "cav_1")
        np.testing.assert_allclose(car.velocity, (100.0, 0.0, 0.0), atol=1e-9)


def test_a_moved_actor_is_hit_where_it_is_and_its_track_comes_back() -> None:
    scene = street()
    car = scene.actors["cav_1"]
    car.position = (40.0, 2.0, 0.25)
    assert down(scene, 40.0, 2.0) == (pytest.approx(1.75, abs=1e-5), "cav_1")
    assert down(scene, -20.0, -3.0)[1] == "street"
    assert car.velocity.tolist() == [0.0, 0.0, 0.0]
    car.velocity, car.angular_velocity = (3.0, 4.0, 0.0), (0.0, 0.0, 0.5)
    car.orientation = (0.0, 0.0, 2.0, 2.0)
    assert car.velocity.tolist() == [3.0, 4.0, 0.0]
    scene.frame = 1
    assert car.position.tolist() == [-19.0, -3.0, 0.0] and car.velocity[0] == pytest.approx(100.0)


@pytest.mark.parametrize("frames", [1, 2, 3, 9])
def test_velocities_that_are_set_are_the_derivatives_of_the_poses(frames: int) -> None:
    """Every reader of poses sees them: sensors, Doppler shifts and rolling sweeps."""
    scene = street(frames, frame=frames // 2)
    car = scene.actors["cav_1"]
    before = differentiate(scene.arrays.poses).velocity[scene.arrays.frame_row(scene.frame), 1]
    car.pose = (5.0, 1.0, 0.0, 0.0, 0.0, 0.6, 0.8)
    car.velocity, car.angular_velocity = (7.0, -2.0, 1.0), (0.1, -0.2, 0.3)
    row, motion = scene.arrays.frame_row(scene.frame), differentiate(scene.arrays.poses)
    np.testing.assert_allclose(motion.velocity[row, 0], (7.0, -2.0, 1.0), atol=1e-10)
    np.testing.assert_allclose(motion.world_rate[row, 0], (0.1, -0.2, 0.3), atol=1e-10)
    np.testing.assert_allclose(motion.acceleration[row, 0], 0.0, atol=1e-9)
    np.testing.assert_allclose(motion.velocity[row, 1], before, atol=1e-9)
    np.testing.assert_allclose(scene.arrays.poses[row, 0], (5.0, 1.0, 0.0, 0.0, 0.0, 0.6, 0.8), atol=1e-15)


def test_a_part_of_the_town_can_be_moved() -> None:
    scene = room()
    house = scene.objects["house"]
    assert house.is_static and house.position.tolist() == [10.0, 0.0, 3.0] and house.size.tolist() == [4.0, 4.0, 6.0]
    number = house.object_id
    house.position = (20.0, 5.0, 3.0)
    assert down(scene, 10.0, 0.0) == (pytest.approx(0.0, abs=1e-5), "ground")
    assert down(scene, 20.0, 5.0) == (pytest.approx(6.0, abs=1e-5), "house")
    assert not house.is_static and house.object_id == number and scene.actors["house"].role == "object"
    house.orientation = (0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))  # lies on its side: 4 m high
    assert down(scene, 20.0, 5.0)[0] == pytest.approx(5.0, abs=1e-4)
    scene.frame = 0
    assert house.position.tolist() == [20.0, 5.0, 3.0], "it has no track to return to"


def test_objects_are_added_cloned_painted_and_removed() -> None:
    scene = room()
    points, faces = box_mesh((1.0, 1.0, 1.0), (0.0, 0.0, 0.5))
    crate = scene.add_object("crate", points, faces, material="brick_facade", label="static", position=(0.0, 8.0, 0.0))
    assert down(scene, 0.0, 8.0) == (pytest.approx(1.0, abs=1e-5), "crate") and crate.material == "brick_facade"
    copy = crate.clone("crate_2", position=(0.0, 12.0, 0.0))
    assert down(scene, 0.0, 12.0)[1] == "crate_2" and copy.object_id != crate.object_id
    twin = scene.objects["shed"].clone("shed_2", position=(-20.0, 0.0, 1.0))
    assert down(scene, -20.0, 0.0) == (pytest.approx(2.0, abs=1e-5), "shed_2") and twin.material == "brick_facade"
    scene.add_material("foil", RadioMaterial("itu", itu="itu_pec"), color=(0.9, 0.9, 0.9))
    for item in (crate, scene.objects["house"]):
        item.material = "foil"
        hit = scene.cast_rays((*item.position[:2], 50.0), (0.0, 0.0, -1.0))
        assert scene.materials_by_id()[hit.material_id[0]].name == "foil"
    hit = scene.cast_rays((0.0, 12.0, 50.0), (0.0, 0.0, -1.0))
    assert scene.materials_by_id()[hit.material_id[0]].name == "brick_facade", "the copy keeps its own"
    twin.position = (-25.0, 3.0, 1.0)
    scene.frame = 0
    assert twin.position.tolist() == [-25.0, 3.0, 1.0], "what was added has no track to return to"
    crate.remove()
    scene.objects["house"].remove()
    assert down(scene, 0.0, 8.0)[1] == down(scene, 10.0, 0.0)[1] == "ground"
    assert "crate" not in scene.actors and "house" not in scene.objects and "crate_2" in scene.actors
    with pytest.raises(InputError, match="was removed from the scene"):
        crate.position = (0.0, 0.0, 0.0)


def test_materials_are_changed_in_one_weather_or_all() -> None:
    data = arrays_from_parts([ground_part()], weathers=("sunny", "rainy"))
    scene = Scene(data, {name: PRESETS[name] for name in ("sunny", "rainy")}, device="cpu")
    asphalt = scene.materials["asphalt"]
    asphalt.set(relative_permittivity=4.0)
    assert asphalt.radio == RadioMaterial("constant", relative_permittivity=4.0) == asphalt.radio_in("rainy")
    asphalt.set("rainy", conductivity=0.2)
    assert asphalt.radio_in("rainy").relative_permittivity == 4.0 and asphalt.radio.conductivity == 0.0
    asphalt.radio = RadioMaterial("itu", itu="itu_metal")
    assert {asphalt.radio_in(name).itu for name in ("sunny", "rainy")} == {"itu_metal"}


def test_devices_ride_on_actors_as_antennas_of_a_run_do() -> None:
    scene = street(frame=1)
    roof = scene.add(mmw.Receiver("roof", (0.5, 0.0, 1.6), actor="cav_1", velocity=(0.0, 0.0, 1.0)))
    free = scene.add(mmw.Transmitter("mast", (1.0, 2.0, 3.0), orientation=(0, 0, 1, 1), velocity=(1, 0, 0)))
    state = scene.antenna_states([roof, free])
    np.testing.assert_allclose(state.position, [(-18.5, -3.0, 1.6), (1.0, 2.0, 3.0)])
    np.testing.assert_allclose(state.velocity, [(100.0, 0.0, 1.0), (1.0, 0.0, 0.0)], atol=1e-9)
    np.testing.assert_allclose(state.rotation[1] @ (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), atol=1e-15)
    free.look_at((1.0, 2.0, 9.0))
    np.testing.assert_allclose(scene.antenna_state(free)[1] @ (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), atol=1e-12)
    free.look_at((-4.0, 2.0, 3.0))
    np.testing.assert_allclose(scene.antenna_state(free)[1] @ (1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), atol=1e-12)
    assert (scene.transmitters["mast"], scene.receivers["roof"]) == (free, roof)
    scene.remove("roof")
    assert not scene.receivers


NAN = float("nan")

ERRORS = {
    "frame": (lambda s: setattr(s, "frame", 9), "scene 'street': frame = 9; it has frames 0 to 3"),
    "frame type": (lambda s: setattr(s, "frame", 0.5), "frame = 0.5"),
    "actor": (lambda s: s.actors["cav_2"], "actor 'cav_2': the scene has cav_1"),
    "object": (lambda s: s.objects["nothing like it"], "object 'nothing like it': the scene has"),
    "material": (lambda s: s.materials["asphlt"], "material 'asphlt': the scene has asphalt"),
    "weather": (lambda s: s.materials_by_id("rainy"), "weather 'rainy'; it was loaded with sunny"),
    "pose": (lambda s: setattr(s.actors["cav_1"], "pose", [NAN] * 7), "object 'cav_1': pose = .* 7 finite numbers"),
    "quaternion": (lambda s: setattr(s.actors["cav_1"], "pose", [0] * 7), r"pose, quaternion = \(0, 0, 0, 0\)"),
    "position": (lambda s: setattr(s.actors["cav_1"], "position", (0, 1)), "position = .* 3 finite numbers"),
    "text": (lambda s: setattr(s.actors["cav_1"], "velocity", "fast"), "velocity = 'fast'; 3 numbers"),
    "paint": (lambda s: setattr(s.actors["cav_1"], "material", "gold"), "material 'gold'; the scene has asphalt"),
    "radio": (lambda s: setattr(s.materials["asphalt"], "radio", 4.0), "a mmw.RadioMaterial is needed"),
    "permittivity": (lambda s: s.materials["asphalt"].set(relative_permittivity=-2.0), "relative_permittivity = -2.0"),
    "scattering": (lambda s: s.materials["asphalt"].set(scattering=1.5), "scattering = 1.5; 0 to 1"),
    "field": (lambda s: s.materials["asphalt"].set(epsilon=2.0), "epsilon = 2.0: no such value"),
    "device": (lambda s: s.add("bs"), "a mmw.Transmitter or mmw.Receiver is needed"),
    "device actor": (lambda s: s.add(mmw.Receiver("r", actor="bus")), "actor 'bus': the scene has"),
    "device twice": (lambda s: [s.add(mmw.Receiver("r")) for _ in "ab"], "receiver 'r': the scene has one"),
    "device nan": (lambda s: mmw.Transmitter("t", (NAN, 0, 0)), "transmitter 't': position = .* finite"),
    "device name": (lambda s: mmw.Receiver(""), "receiver: name = ''"),
    "device array": (lambda s: mmw.Receiver("r", array="big"), "a mmw.PlanarArray is needed"),
    "power": (lambda s: mmw.Transmitter("t", power_dbm=NAN), "power_dbm"),
    "no elements": (lambda s: mmw.PlanarArray(num_rows=0), "num_rows = 0"),
    "look_at": (lambda s: mmw.Receiver("r", (1, 2, 3)).look_at((1, 2, 3)), "the target is the position itself"),
    "remove": (lambda s: s.remove("ue"), "no transmitter or receiver 'ue'; it has none"),
    "rays": (lambda s: s.cast_rays((0, 0, 0), (0, 0, 0)), "a direction is zero"),
    "rays shape": (lambda s: s.cast_rays(np.zeros((2, 3)), np.ones((3, 3))), r"\(2, 3\), directions \(3, 3\)"),
    "mesh": (lambda s: s.add_object("a", [(0, 0, 0)], [(0, 1, 2)], material="asphalt"), "faces name vertex 2"),
    "label": (
        lambda s: s.add_object("a", np.eye(3), [(0, 1, 2)], material="asphalt", label="cat"),
        "label = 'cat'; known are",
    ),
    "taken": (lambda s: s.actors["cav_1"].clone("veh_001"), "object 'veh_001': the scene has an actor of this name"),
    "material taken": (lambda s: s.add_material("asphalt", RadioMaterial("itu", itu="itu_metal")), "has one of this"),
    "device kind": (lambda s: Scene(two_cars(1), {"sunny": PRESETS["sunny"]}, device="cuda:99"), "cuda:99"),
    "no weather": (lambda s: Scene(two_cars(1), {}), "no weather; the data has materials of sunny"),
}


@pytest.mark.parametrize("case", ERRORS)
def test_bad_input_is_one_clear_error(case: str) -> None:
    act, message = ERRORS[case]
    with pytest.raises(InputError, match=message) as caught:
        act(street())
    assert "\n" not in str(caught.value)


def test_a_closed_scene_says_so() -> None:
    with street() as scene:
        device_scene = scene.device_scene
        scene.add(mmw.Receiver("ue"))
    for act in (
        lambda: scene.cast_rays((0, 0, 9), (0, 0, -1)),
        lambda: scene.device_scene,
        lambda: scene.actors,
        lambda: scene.add(mmw.Receiver("other")),
        lambda: mmw.PathSolver()(scene),
        lambda: setattr(scene, "frame", 1),
    ):
        with pytest.raises(InputError, match="scene 'street': is closed; load it again"):
            act()
    assert "closed" in repr(scene) and device_scene is not None


def test_closing_frees_what_is_on_the_device() -> None:
    import weakref

    scene = street()
    on_device = weakref.ref(scene.device_scene)
    scene.close()
    gc.collect()
    assert on_device() is None

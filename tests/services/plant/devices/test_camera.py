import math

import numpy as np
import pinocchio
import pytest
from support.services.camera import (
    IMAGES,
    WORLD,
    colours,
    is_orange,
    make_plant,
    metres,
    rays,
    write_scene,
)
from support.services.control import Stand

from stepbus_schemas import CameraTrigger, WiringError


def see(folder, **more):
    """Return colours and depth of the first step."""
    shown = make_plant(folder, IMAGES, **more).output(None)
    return shown["rgb"], shown["depth"]


def steps_with_images(participant, port, steps):
    stand = Stand(participant)
    return [step for step in range(steps) if port in stand.update(step)]


def test_a_box_is_seen_at_its_pixels_with_its_depth_and_colour(tmp_path):
    write_scene(tmp_path)
    rgb, depth = see(tmp_path)
    assert (rgb.encoding, depth.encoding) == ("rgb8", "32FC1")
    x, y = np.moveaxis(0.9 * rays(rgb), -1, 0)
    top = (x > 0.0) & (x < 0.2) & (y < 0.0) & (y > -0.1)
    assert top.sum() > 1000
    np.testing.assert_array_equal(is_orange(rgb), top)
    np.testing.assert_allclose(metres(depth)[top], 0.9, atol=1e-4)
    assert colours(rgb)[top].max() > 0.6 * 255


def test_what_is_behind_the_box_is_the_floor_and_beside_the_floor_is_nothing(tmp_path):
    write_scene(tmp_path)
    rgb, depth = see(tmp_path)
    x = rays(rgb)[..., 0]
    assert np.isposinf(metres(depth)[x < -0.201]).all()
    floor = (x > -0.199) & ~is_orange(rgb)
    np.testing.assert_allclose(metres(depth)[floor], 1.0, atol=1e-4)
    assert len(np.unique(colours(rgb)[floor].reshape(-1, 3), axis=0)) == 1


def test_what_a_tilted_camera_sees_lies_on_the_surface_of_the_box(tmp_path):
    rpy = (math.pi - 0.3, 0.2, 0.5)
    write_scene(tmp_path, tilt=" ".join(map(str, rpy)))
    rgb, depth = see(tmp_path)
    orange = is_orange(rgb)
    z = metres(depth)[orange][:, None].astype(float)
    points = np.hstack([rays(rgb)[orange] * z, z])
    rotation = pinocchio.rpy.rpyToMatrix(*rpy)
    in_box = np.abs(points @ rotation.T + [0, 0, 1] - [0.1, 0.05, 0.05])
    outside = (in_box - [0.1, 0.05, 0.05]).max(axis=1)
    assert orange.sum() > 1000
    np.testing.assert_allclose(outside, 0.0, atol=5e-4)


def test_focal_length_and_centre_follow_from_the_angle_of_view(tmp_path):
    write_scene(tmp_path)
    rgb, _ = see(tmp_path)
    assert rgb.focal == pytest.approx([120 / math.tan(0.5)] * 2)
    assert rgb.centre == (159.5, 119.5)


def test_a_body_without_visuals_is_seen_by_its_collision_shapes_in_white(tmp_path):
    write_scene(tmp_path, WORLD.replace("crate.urdf,", "crate.urdf, visuals: false,"))
    rgb, depth = see(tmp_path)
    top = abs(metres(depth) - 0.9) < 1e-3
    assert top.sum() > 1000
    red, green, blue = np.moveaxis(colours(rgb)[top], -1, 0)
    np.testing.assert_array_equal(red, green)
    np.testing.assert_array_equal(red, blue)


def test_what_is_too_near_or_too_far_is_not_seen(tmp_path):
    write_scene(tmp_path, WORLD.replace("near: 0.1, far: 1.5", "near: 0.95, far: 0.99"))
    rgb, depth = see(tmp_path)
    assert np.isposinf(metres(depth)).all()
    assert not is_orange(rgb).any()


def test_a_camera_sees_what_has_moved(tmp_path):
    falling = WORLD.replace("0.05], fixed_base: true", "0.4]")
    write_scene(tmp_path, falling)
    stand = Stand(make_plant(tmp_path, IMAGES))
    for step in range(20):
        stand.update(step)
    # 0.1 s in free fall, with Euler's steps: 5 ms · 9.81 m/s² · (1 + … + 20) · 5 ms.
    depth = metres(stand.participant.output(None)["depth"])
    assert depth.min() == pytest.approx(0.55 + 9.81 * 0.005**2 * 210, abs=1e-4)


def test_images_come_at_multiples_of_the_period(tmp_path):
    write_scene(tmp_path)
    assert steps_with_images(make_plant(tmp_path, IMAGES), "depth", 6) == [0, 2, 4]


def test_a_camera_is_rendered_once_for_all_its_ports_and_only_when_due(tmp_path, monkeypatch):
    write_scene(tmp_path)
    many, none = (
        make_plant(tmp_path, outputs)
        for outputs in ({**IMAGES, "wrist_rgb": "Image/1"}, {"state": "JointState/1"})
    )
    calls = []
    engine = type(many.plant.physics.engine)
    render = engine.image
    monkeypatch.setattr(engine, "image", lambda *a: calls.append(1) or render(*a))
    steps_with_images(many, "rgb", 4)
    assert len(calls) == 2
    steps_with_images(none, "rgb", 4)
    assert len(calls) == 2


def test_cameras_that_are_switched_off_give_nothing(tmp_path):
    write_scene(tmp_path)
    assert steps_with_images(make_plant(tmp_path, IMAGES, cameras=False), "rgb", 4) == []


TRIGGER = {"wrist": "CameraTrigger/1"}


def test_a_camera_with_an_input_takes_images_on_request_only(tmp_path):
    write_scene(tmp_path)
    stand = Stand(make_plant(tmp_path, IMAGES, TRIGGER))
    asked = {2: 0, 3: 0, 5: 1, 6: 2}
    rows = [
        stand.update(step, **({"wrist": CameraTrigger(id=asked[step])} if step in asked else {}))
        for step in range(9)
    ]
    # The second request is the first one, repeated.
    assert [step for step, row in enumerate(rows) if "rgb" in row] == [3, 6, 7]
    assert [step for step, row in enumerate(rows) if "depth" in row] == [3, 6, 7]


def test_a_request_to_a_camera_that_is_off_is_lost(tmp_path):
    write_scene(tmp_path)
    script = [{"at": "5ms", "camera": "wrist"}, {"at": "20ms", "camera": "wrist", "off": False}]
    stand = Stand(make_plant(tmp_path, IMAGES, TRIGGER, script=script))
    rows = [stand.update(step, wrist=CameraTrigger(id=step)) for step in range(8)]
    assert [step for step, row in enumerate(rows) if "rgb" in row] == [1, 5, 6, 7]


def test_a_camera_without_a_period_takes_an_image_at_each_step(tmp_path):
    write_scene(tmp_path, WORLD.replace("period: 10ms, ", ""))
    assert steps_with_images(make_plant(tmp_path, IMAGES), "depth", 3) == [0, 1, 2]


def test_requests_to_a_camera_that_the_world_lacks_are_refused(tmp_path):
    write_scene(tmp_path, WORLD[WORLD.index("bodies:") :])
    with pytest.raises(WiringError, match="world has no 'cameras'"):
        make_plant(tmp_path, {}, TRIGGER)


def test_a_description_names_camera_link_and_shape(tmp_path):
    write_scene(tmp_path)
    told = make_plant(tmp_path, IMAGES).describe()
    assert told["rgb"].names == ["wrist"]
    assert told["rgb"].shape == [240, 320, 3]
    assert told["depth"].shape == [240, 320, 1]
    assert told["depth"].details == {"link": ["lens"], "period": ["10ms"]}


def test_with_two_cameras_a_port_names_the_camera_too(tmp_path):
    second = "  top: {link: legs, period: 10ms, width: 16, height: 8}\nbodies:"
    write_scene(tmp_path, WORLD.replace("bodies:", second))
    shown = make_plant(tmp_path, {"top_depth": "Image/1", "wrist_rgb": "Image/1"}).output(None)
    assert shown["top_depth"].width == 16
    assert shown["wrist_rgb"].width == 320
    with pytest.raises(WiringError) as caught:
        make_plant(tmp_path, {"rgb": "Image/1", "wrist_rg": "Image/1"})
    rows = str(caught.value).splitlines()
    assert [row.split("outputs.")[1].split(":")[0] for row in rows] == ["rgb", "wrist_rg"]
    assert rows[0].endswith("wrist_rgb, top_rgb, wrist_depth, top_depth")


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        (
            "link: lens",
            "link: lense",
            "wrist.link: link 'lense' is unknown; did you mean 'lens'",
        ),
        (
            "fov: 1.0",
            "fov: 60",
            "fov: 60 rad is half a turn or more; angles are in radians",
        ),
        ("far: 1.5", "far: 0.1", "near: 0.1 m is not less than 'far', 0.1 m"),
        ("10ms", "12ms", "period: 12ms is not a multiple of the plant's step (5ms)"),
        ("fov: 1.0", "latency: 12ms", "latency: 12ms is not a multiple of the plant's step (5ms)"),
        ("10ms", "often", "period: 'often' is not a duration"),
        ("near: 0.1", "width: 0", "width: must be an integer from 1 to 4096, not 0"),
        ("near: 0.1", "nera: 0.1", "wrist.nera: unknown key 'nera'; did you mean 'near'"),
    ],
)
def test_a_camera_that_cannot_work_is_refused(tmp_path, old, new, text):
    write_scene(tmp_path, WORLD.replace(old, new))
    with pytest.raises(WiringError) as caught:
        make_plant(tmp_path, IMAGES)
    assert text in str(caught.value)
    assert "world.yaml:3" in str(caught.value)

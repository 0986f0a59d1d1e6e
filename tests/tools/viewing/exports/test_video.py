"""Films of a recording: decoded again, they show motion."""

import av
import numpy as np
import pytest
from PIL import Image as Pillow
from support.messages.recordings import write

from stepbus_orchestrator.cli.entry import main
from stepbus_orchestrator.run.result import Result
from stepbus_schemas import Description, Image, Poses
from stepbus_tools.viewing.rasteriser import Painter
from stepbus_tools.viewing.scene.meshes import Visual, primitive
from stepbus_tools.viewing.scene.pose import Pose
from stepbus_tools.viewing.scene.scene import Frame, Scene
from stepbus_tools.viewing.viewpoint import Swept, clear_corner, framed, parse_viewpoint

SHAPES = {"shape": ["box 0.4 0.2 0.2"], "color": ["200 30 30"], "body": ["box"]}


def image(step):
    pixels = np.full((33, 65, 3), 40, np.uint8)
    pixels[:, 2 * step : 2 * step + 8] = (250, 20, 20)
    return Image(
        width=65, height=33, encoding="rgb8", data=pixels.tobytes(), focal=(9.0, 9.0),
        centre=(32.0, 16.0),
    )  # fmt: skip


def pose(step):
    return Poses(position=[(step * 0.05, 0.0, 0.0)], orientation=[(0.0, 0.0, 0.0, 1.0)])


@pytest.fixture
def camera(tmp_path):
    images = [image(step) for step in range(20)]
    return write(tmp_path / "run.mcap", 100_000_000, camera=("Image/1", [], images))


@pytest.fixture
def moving(tmp_path):
    about = Description(names=["crate"], details=SHAPES)
    rows = [pose(step) for step in range(11)]
    return write(tmp_path / "run.mcap", 40_000_000, poses=("Poses/1", about, rows))


def decoded(path):
    with av.open(str(path)) as container:
        return [(float(f.time), f.to_ndarray(format="rgb24")) for f in container.decode(video=0)]


def test_the_mp4_of_a_camera_has_even_sizes_its_times_and_motion(camera, tmp_path):
    assert main(["export", str(camera), "--video", str(tmp_path / "a.mp4")]) == 0
    frames = decoded(tmp_path / "a.mp4")
    assert frames[0][1].shape == (34, 66, 3)
    assert [t for t, _ in frames] == pytest.approx([0.1 * n for n in range(20)], abs=2e-3)
    reds = [float(np.argmax(pixels[16, :, 0].astype(int))) for _, pixels in frames]
    assert reds[-1] - reds[0] > 30


@pytest.mark.parametrize(
    ("step_ms", "size"),
    [(900, (65, 33)), pytest.param(1100, (640, 480), marks=pytest.mark.slow)],
)
def test_of_a_camera_that_takes_few_images_the_scene_is_shown(tmp_path, step_ms, size):
    about = Description(names=["crate"], details=SHAPES)
    ports = {
        "camera": ("Image/1", [], [image(step) for step in range(4)]),
        "poses": ("Poses/1", about, [pose(step) for step in range(4)]),
    }
    recording = write(tmp_path / "run.mcap", step_ms * 1_000_000, **ports)
    assert main(["export", str(recording), "--video", str(tmp_path / "a.gif")]) == 0
    with Pillow.open(tmp_path / "a.gif") as film:
        assert film.size == size


@pytest.mark.parametrize("fps", [30, 60])
def test_a_gif_lasts_as_long_as_what_it_shows(tmp_path, fps):
    images = [image(step % 20) for step in range(3 * fps + 1)]
    path = write(tmp_path / "run.mcap", round(1e9 / fps), camera=("Image/1", [], images))
    assert main(["export", str(path), "--video", str(tmp_path / "a.gif")]) == 0
    with Pillow.open(tmp_path / "a.gif") as film:
        lasts = []
        for number in range(film.n_frames):
            film.seek(number)
            lasts.append(film.info["duration"])
    # The last image stays for 0.5 s more.
    assert sum(lasts) - 500 == pytest.approx(3000, abs=40)


def test_the_scene_is_drawn_from_a_viewpoint_without_a_display(moving, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    words = ["--viewpoint", "0.25,-2,0.5:0.25,0,0"]
    assert main(["export", str(moving), "--video", str(tmp_path / "a.mp4"), *words]) == 0
    frames = [pixels.astype(int) for _, pixels in decoded(tmp_path / "a.mp4")]
    # Above the caption.
    drawn = [np.flatnonzero((f[:-30, :, 0] < 200).any(axis=0)) for f in frames]
    assert all(len(columns) > 50 for columns in drawn)
    assert drawn[-1].mean() - drawn[0].mean() > 80


def test_a_film_has_the_size_the_rate_and_the_span_that_are_asked_for(moving, tmp_path):
    words = ["--size", "321x181", "--fps", "50", "--from", "100ms", "--to", "0.3s"]
    assert main(["export", str(moving), "--video", str(tmp_path / "a.mp4"), *words]) == 0
    frames = decoded(tmp_path / "a.mp4")
    assert frames[0][1].shape == (182, 322, 3)
    assert [t for t, _ in frames] == pytest.approx([n / 50 for n in range(11)])


def test_a_film_shows_the_time_the_scenario_and_how_the_run_ended(moving, tmp_path):
    Result(
        scenario="moving", outcome="finished", exit_code=0, reason="finished", participant=None,
        at_step=0, steps=1, step_ns=1, seed=0, window=1, transport="unix", start_s=0.0, wall_s=1.0,
        real_time_factor=1.0, sha256="", folder=str(moving.parent),
    ).save()  # fmt: skip
    assert main(["export", str(moving), "--video", str(tmp_path / "a.mp4")]) == 0
    frames = [pixels for _, pixels in decoded(tmp_path / "a.mp4")]
    before, middle, end = (
        (f[-40:].astype(int) < 100).all(axis=2) for f in frames[:: len(frames) // 2]
    )
    assert before.sum() > 50
    assert (before != middle).sum() > 10
    assert end.sum() > middle.sum() + 50


@pytest.mark.slow
def test_the_camera_sees_all_that_moves_during_the_film(tmp_path):
    about = Description(names=["crate"], details=SHAPES | {"color": ["0.8 0.1 0.1"]})
    rows = [Poses(position=[(x, 0.0, 0.0)], orientation=[(0.0, 0.0, 0.0, 1.0)]) for x in (0, 3, -3)]
    path = write(tmp_path / "run.mcap", 40_000_000, poses=("Poses/1", about, rows))
    assert main(["export", str(path), "--video", str(tmp_path / "a.mp4")]) == 0
    for _, pixels in decoded(tmp_path / "a.mp4"):
        red = (pixels[:, :, 0].astype(int) - pixels[:, :, 1]) > 60
        assert red.sum() > 50
        assert not red[[0, -1]].any()
        assert not red[:, [0, -1]].any()


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--video", "a.mp4", "--size", "big"], "write width and height in pixels"),
        (["--video", "a.mp4", "--size", "8x8"], "16 to 4096"),
        (["--video", "a.mp4", "--fps", "0"], "more than 0 and at most 120"),
        (["--video", "a.mp4", "--fps", "many"], "frames per second"),
        (["--video", "a.mp4", "--from", "9s"], "no image in this time range"),
        (["--video", "a.mp4", "--from", "200ms", "--to", "0.1s"], "no image in this time range"),
        (["--video", "a.mp4", "--to", "5"], "is not a duration"),
        (["--csv", "a.csv", "--fps", "10"], "--fps goes with --video"),
        (["--video", "a.avi"], "is not a video file: write .mp4 or .gif"),
        (["--video", "a.mp4", "--camera", "plant.none"], "has no port 'plant.none'"),
        (["--video", "a.mp4", "--viewpoint", "behind"], "'behind' is not a viewpoint"),
    ],
)
def test_what_cannot_be_filmed_is_one_sentence(
    moving, tmp_path, monkeypatch, capsys, words, sentence
):
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(moving), *words]) != 0
    error = capsys.readouterr().err
    assert sentence in error
    assert error.count("\n") == 1
    assert not list(tmp_path.glob("*a.*"))


def box(size, position, color):
    visual = Visual(mesh=primitive("box", size), color=color)
    return Frame(name=str(position), pose=Pose(position), visuals=(visual,))


def test_what_is_nearer_hides_what_is_behind_it_and_a_cut_floor_is_drawn():
    frames = [
        box((0.5, 0.5, 0.5), (0.0, 0.0, 0.0), (255, 0, 0)),
        box((1.0, 1.0, 1.0), (0.0, 2.0, 0.0), (0, 255, 0)),
        box((40.0, 40.0, 0.1), (0.0, 0.0, -1.0), (0, 0, 255)),
    ]
    scene = Scene(frames=frames, motions=())
    view = parse_viewpoint("0,-3,0.2:0,0,0", box_of(scene))
    pixels = Painter(scene, (120, 90)).draw({}, view).astype(int)
    assert pixels[45, 60].argmax() == 0
    assert pixels[86, 60].argmax() == 2
    assert (pixels[:, :, 0] > 200).sum() > 100


def box_of(scene):
    """Return the box of a scene in which nothing moves."""
    found = Swept(scene)
    found.take({})
    return found.box


def test_a_wall_before_the_corner_is_seen_from_another_side():
    seen = np.zeros(3), np.ones(3)
    wall = np.array([[(1.2, -2.0, 0.0), (1.3, 2.0, 3.0)]])
    assert clear_corner(seen, wall[:0]).tolist() == [0.62, -0.62, 0.42]
    assert clear_corner(seen, wall).tolist() == [-0.62, -0.62, 0.42]
    assert (framed(seen, fixed=wall).eye[0] < 0, framed(seen).eye[0] > 1) == (True, True)


def test_a_picture_without_a_background_keeps_the_colour_of_its_edges():
    scene = Scene(frames=[box((0.5, 0.5, 0.5), (0.0, 0.0, 0.0), (255, 0, 0))], motions=())
    picture = Painter(scene, (60, 40), smooth=True).cut_out({}, framed(box_of(scene)))
    cover = picture[:, :, 3]
    assert (picture.shape, cover[0, 0], cover[20, 30]) == ((40, 60, 4), 0, 255)
    assert ((cover > 0) & (cover < 255)).any()
    assert picture[:, :, 1].max() == picture[:, :, 2].max() == 0


@pytest.mark.parametrize("shape", ["box", "capsule", "cylinder", "sphere"])
def test_primitives_are_closed_and_turned_outwards(shape):
    sizes = {"box": (1.0, 2.0, 3.0), "sphere": (0.5,)}.get(shape, (0.5, 2.0))
    mesh = primitive(shape, sizes)
    corners = mesh.vertices[mesh.faces].astype(float)
    volume = np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    exact = {"box": 6.0, "sphere": 0.524, "cylinder": 1.571, "capsule": 2.094}[shape]
    assert volume == pytest.approx(exact, rel=0.05)

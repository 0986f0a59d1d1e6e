"""An export for Rerun, read by Rerun's own reader."""

import io
import math
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image as Pillow
from support.messages.recordings import write

from stepbus_orchestrator.cli.entry import main
from stepbus_orchestrator.errors import ExitCode
from stepbus_schemas import Description, Event, Image, JointState, Poses

chunk = pytest.importorskip("rerun.chunk", reason="Rerun is not installed: the extra `rerun`")
STEP_NS = 10_000_000
STEPS = 100
SHAPES = {"shape": ["box 0.4 0.2 0.2"], "color": ["0.8 0.1 0.1"], "body": ["crate"]}
IMAGE = Image(
    width=16, height=8, encoding="rgb8", data=bytes(16 * 8 * 3), focal=(9.0, 9.0), centre=(8.0, 4.0)
)


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    """Path of an entity → column → its (time [ns], value); without a time: static."""
    folder = tmp_path_factory.mktemp("rerun")
    poses = [
        Poses(position=[(s * 0.01, 0.0, 0.5)], orientation=[(0.0, 0.0, 0.0, 1.0)])
        for s in range(STEPS)
    ]
    path = write(
        folder / "run.mcap",
        STEP_NS,
        joint_state=("JointState/1", ["hip", "knee"], [joints(step) for step in range(STEPS)]),
        poses=("Poses/1", Description(names=["crate"], details=SHAPES), poses),
        camera=("Image/1", [], [IMAGE]),
        events=("Event/1", [], [None, Event(level="warning", text="slow")]),
    )
    assert main(["export", str(path), "--rerun", str(folder / "run.rrd")]) == 0
    found = {}
    for part in chunk.RrdReader(folder / "run.rrd").stream():
        batch = part.to_record_batch().to_pydict()
        times = batch.get("time") or [None] * part.num_rows
        for name, values in batch.items():
            column = found.setdefault(part.entity_path, {}).setdefault(name, [])
            column += zip(
                (t if t is None else round(t.total_seconds() * 1e9) for t in times),
                values,
                strict=True,
            )
    return found


def joints(step):
    return JointState(position=[math.sin(step / 20), 0.5])


def test_every_number_is_a_point_of_a_curve_with_a_name_and_a_unit(rows):
    curve = rows["/plant/joint_state/position"]
    assert sorted(curve["Scalars:scalars"]) == [
        (step * STEP_NS, [math.sin(step / 20), 0.5]) for step in range(STEPS)
    ]
    ((_, names),) = curve["SeriesLines:names"]
    assert names == ["hip [rad]", "knee [rad]"]
    # Nothing that the recording lacks has a curve.
    assert not any("velocity" in place for place in rows)


def test_a_mesh_moves_with_its_link(rows):
    ((_, corners),) = rows["/world/crate/visual_0"]["Mesh3D:vertex_positions"]
    assert np.ptp(np.array(corners), axis=0) == pytest.approx([0.4, 0.2, 0.2])
    moves = rows["/world/crate"]["Transform3D:translation"]
    assert 28 <= len(moves) <= 31
    for t_ns, ((x, _, z),) in moves:
        assert (x, z) == pytest.approx((t_ns / STEP_NS * 0.01, 0.5))


def test_events_are_a_log_and_images_are_shown(rows):
    log = rows["/events/plant"]
    assert log["TextLog:text"] == [(STEP_NS, ["slow"])]
    assert log["TextLog:level"] == [(STEP_NS, ["WARN"])]
    ((t_ns, (data,)),) = rows["/plant/camera"]["EncodedImage:blob"]
    assert (t_ns, Pillow.open(io.BytesIO(bytes(data))).size) == (0, (16, 8))


def test_nothing_in_the_file_is_of_the_wall_clock(rows):
    assert not any("log_time" in columns for columns in rows.values())


FULL_DISK = """
import resource, sys
from stepbus_orchestrator.cli import main
sys.dont_write_bytecode = True  # what is imported now would be cached in part
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, resource.RLIM_INFINITY))
sys.exit(main(sys.argv[1:]))
"""


def test_a_disk_that_is_full_is_one_sentence_and_leaves_no_file(tmp_path):
    path = write(
        tmp_path / "run.mcap",
        joint_state=("JointState/1", ["hip", "knee"], list(map(joints, range(2000)))),
    )
    words = ["export", str(path), "--rerun", str(tmp_path / "a.rrd")]
    command = [sys.executable, "-c", FULL_DISK, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == ExitCode.RECORDING
    assert "a.rrd cannot be written" in done.stderr
    assert "Traceback" not in done.stderr
    assert [file.name for file in tmp_path.iterdir()] == ["run.mcap"]

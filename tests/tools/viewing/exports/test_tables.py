"""Tables of a recording, read by what users read them with."""

import csv
import math
from collections import Counter

import duckdb
import polars as pl
import pyarrow.parquet as parquet
import pytest
from support.messages.recordings import messages, write
from support.paths import GOLDEN_LOGS

from stepbus_orchestrator.cli.entry import main
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import Contacts, ControllerStatus, Description, Event, Image, JointState, Poses

STEPS = 300
IMAGE = Image(
    width=2, height=1, encoding="rgb8", data=b"abcdef", focal=(1.0, 1.0), centre=(1.0, 0.5)
)


def state(step):
    return JointState(position=[math.sin(step / 50), step * 0.1])


def contacts(step):
    pairs = [("a", "b")] * (step % 3)
    count = len(pairs)
    return Contacts(
        pairs=pairs, force=[2.5] * count, distance=[0.0] * count, position=[(0.0, 0.0, 1.0)] * count
    )


@pytest.fixture
def recording(tmp_path):
    return write(
        tmp_path / "run.mcap",
        joint_state=("JointState/1", ["hip", "knee"], [state(step) for step in range(STEPS)]),
        contacts=("Contacts/1", [], [contacts(step) for step in range(STEPS)]),
        poses=(
            "Poses/1",
            Description(names=["tip"], units={"position": "mm"}),
            [Poses(position=[(1.0, 2.0, 3.0)], orientation=[(0.0, 0.0, 0.0, 1.0)])] * 3,
        ),
        events=("Event/1", [], [None, Event(level="warning", text='it\'s, "slow"')]),
        image=("Image/1", [], [IMAGE]),
    )


@pytest.fixture(params=GOLDEN_LOGS, ids=lambda path: path.stem)
def golden(request):
    return request.param


def export(recording, *words):
    assert main(["export", str(recording), *map(str, words)]) == 0


def test_duckdb_answers_a_query_on_parquet_and_units_are_in_its_schema(recording, tmp_path):
    export(recording, "--parquet", tmp_path / "tables")
    path = tmp_path / "tables/plant.joint_state.parquet"
    query = f'select count(*), max("position.knee"), max(t), count("effort.hip") from \'{path}\''
    assert duckdb.sql(query).fetchall()[0] == (STEPS, pytest.approx(29.9), pytest.approx(2.99), 0)
    assert pl.read_parquet(path)["position.hip"][100] == math.sin(2.0)
    schema = parquet.read_schema(path)
    assert schema.field("position.hip").metadata[b"unit"] == b"rad"
    assert schema.metadata[b"stepbus.names"] == b'["hip", "knee"]'


def test_vectors_of_changing_length_names_of_links_and_bytes_have_columns(recording, tmp_path):
    export(recording, "--parquet", tmp_path / "tables")
    contacts = pl.read_parquet(tmp_path / "tables/plant.contacts.parquet")
    assert contacts["force"].to_list()[:3] == [[], [2.5], [2.5, 2.5]]
    assert contacts["pairs"][1] == '[["a","b"]]'
    poses = pl.read_parquet(tmp_path / "tables/plant.poses.parquet")
    assert poses.columns[3:] == [f"position.tip.{axis}" for axis in "xyz"] + [
        f"orientation.tip.{axis}" for axis in "xyzw"
    ]
    assert poses["position.tip.z"].to_list() == [3.0, 3.0, 3.0]
    assert pl.read_parquet(tmp_path / "tables/plant.image.parquet")["data"][0] == IMAGE.data


def test_csv_has_every_digit_and_says_its_units_in_a_file_of_its_own(recording, tmp_path):
    export(recording, "--csv", tmp_path / "csv")
    with (tmp_path / "csv/plant.joint_state.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["position.hip"]) for row in rows] == [math.sin(s / 50) for s in range(STEPS)]
    assert rows[1]["effort.hip"] == ""
    with (tmp_path / "csv/columns.csv").open(newline="") as file:
        units = {(row["file"], row["column"]): row["unit"] for row in csv.DictReader(file)}
    assert units["plant.joint_state.csv", "position.knee"] == "rad"
    assert units["plant.poses.csv", "position.tip.x"] == "mm"


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_one_file_has_a_row_for_each_value(recording, tmp_path, form):
    path = tmp_path / f"all.{form}"
    export(recording, f"--{form}", path)
    hip = f"select count(*), max(value), any_value(unit) from '{path}' where signal = "
    found = duckdb.sql(hip + "'plant.joint_state.position.hip'").fetchall()[0]
    assert found == (STEPS, pytest.approx(1.0, abs=1e-3), "rad")
    text = f"select text from '{path}' where signal = 'plant.events.text'"
    assert duckdb.sql(text).fetchall()[0] == ('it\'s, "slow"',)


def test_half_a_recording_is_exported_up_to_its_damage(tmp_path, capsys):
    rows = [state(step) for step in range(4000)]
    path = tmp_path / "run.mcap"
    recording = write(path, joint_state=("JointState/1", ["hip", "knee"], rows))
    data = recording.read_bytes()
    recording.write_bytes(data[: len(data) // 2])
    export(recording, "--parquet", tmp_path / "tables")
    rows = pl.read_parquet(tmp_path / "tables/plant.joint_state.parquet")
    with Recording(recording) as cut:
        assert 0 < len(rows) == len(cut["plant.joint_state"]) < 4000
    assert "is damaged: " in capsys.readouterr().err


def test_a_port_whose_messages_are_wrong_ends_alone(tmp_path, capsys):
    good = ControllerStatus(error=[0.1, 0.2], saturated=[False, True])
    rows = [good] * 3 + [Event(level="info", text="no state")]
    path = write(
        tmp_path / "run.mcap",
        status=("ControllerStatus/1", ["hip", "knee"], rows),
        events=("Event/1", [], [Event(level="info", text="good")] * 4),
    )
    assert main(["export", str(path), "--csv", str(tmp_path / "csv")]) == ExitCode.RECORDING
    assert "plant/status: " in capsys.readouterr().err
    assert len((tmp_path / "csv/plant.events.csv").read_text().splitlines()) == 5


def test_an_empty_vector_has_no_values_and_ends_no_port(tmp_path):
    rows = [state(0), JointState(position=[]), JointState(position=[0.5, 1.0])]
    for name, given in {"some": rows, "all": rows[1:2] * 3}.items():
        path = write(tmp_path / f"{name}.mcap", state=("JointState/1", ["hip", "knee"], given))
        export(path, "--parquet", tmp_path / name)
        found = pl.read_parquet(tmp_path / name / "plant.state.parquet")
        expected = [m.position[1] if m.position else None for m in given]
        assert found["position.knee"].to_list() == expected


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_every_port_of_the_shipped_scenarios_is_exported_whole(tmp_path, form, golden):
    """The messages are counted by the mcap package."""
    export(golden, f"--{form}", tmp_path)
    counted = Counter(topic for topic, *_ in messages(golden) if not topic.startswith("stepbus/"))
    assert len(counted) >= 4
    for topic, count in counted.items():
        path = tmp_path / f"{topic.replace('/', '.')}.{form}"
        read = pl.read_parquet if form == "parquet" else pl.read_csv
        assert len(read(path)) == count, topic


def test_a_file_that_cannot_be_written_is_one_sentence_and_leaves_nothing(recording, capsys):
    assert main(["export", str(recording), "--csv", "/proc/none/all.csv"]) != 0
    assert "cannot be written" in capsys.readouterr().err

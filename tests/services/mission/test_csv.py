"""Trajectories from CSV files."""

import math
from pathlib import Path

import pytest
from support.services.control import make_mission, mission_config

from stepbus_mission.mission import Mission
from stepbus_schemas import JointReference, WiringError

COLUMNS = {
    "position": ["a"],
    "velocity": ["a", "a_velocity"],
    "acceleration": ["a_acceleration", "a", "a_velocity"],
}
VALUES = {"a": math.sin, "a_velocity": math.cos, "a_acceleration": lambda t: -math.sin(t)}


def write(folder: Path, text: str) -> None:
    (folder / "path.csv").write_text(text)


def write_sine(folder: Path, columns: list[str], rows: int = 63) -> None:
    """Write sin t, sampled every 0.1 s, with the derivatives that are wanted."""
    lines = [",".join(["t", *columns])]
    for k in range(rows):
        t = 0.1 * k
        lines.append(",".join(repr(v) for v in (t, *(VALUES[name](t) for name in columns))))
    write(folder, "\n".join(lines))


def follow(folder: Path, t: float) -> JointReference:
    mission = make_mission(mission_config(folder, task="csv", joints=["a"], file="path.csv"))
    return mission.participant.generator.at(t)


def problems_of(folder: Path, text: str, **params: object) -> list[str]:
    write(folder, text)
    with pytest.raises(WiringError) as caught:
        Mission(mission_config(folder, task="csv", joints=["a", "b"], file="path.csv", **params))
    return [line.partition("path.csv:")[2] for line in str(caught.value).splitlines()]


@pytest.mark.parametrize(
    ("given", "tolerance"), [("position", 3e-6), ("velocity", 3e-7), ("acceleration", 1e-9)]
)
def test_rows_of_a_sine_are_followed_closely(tmp_path, given: str, tolerance: float) -> None:
    write_sine(tmp_path, COLUMNS[given])
    for t in (1.0, 1.55, 3.123):
        assert follow(tmp_path, t).position == pytest.approx([math.sin(t)], abs=tolerance)


@pytest.mark.parametrize("given", COLUMNS)
@pytest.mark.parametrize("t", [0.03, 1.55, 6.19])
def test_its_derivatives_are_exact(tmp_path, given: str, t: float) -> None:
    write_sine(tmp_path, COLUMNS[given])
    h = 1e-4
    before, now, after = (follow(tmp_path, t + dt) for dt in (-h, 0.0, h))
    slope = (after.position[0] - before.position[0]) / (2 * h)
    curvature = (after.velocity[0] - before.velocity[0]) / (2 * h)
    assert now.velocity == pytest.approx([slope], abs=1e-7)
    assert now.acceleration == pytest.approx([curvature], abs=1e-6)


def test_positions_alone_give_a_continuous_acceleration(tmp_path) -> None:
    write(tmp_path, "t,a\n0,0\n1,2\n1.5,-1\n4,3\n")
    for knot in (1.0, 1.5):
        left, right = follow(tmp_path, knot - 1e-9), follow(tmp_path, knot + 1e-9)
        assert left.acceleration == pytest.approx(right.acceleration, abs=1e-6)
    assert follow(tmp_path, 0.0).acceleration == pytest.approx([0.0], abs=1e-12)


@pytest.mark.parametrize(("t", "position"), [(0.0, 2.0), (1.0, 2.0), (3.0, 5.0), (9.0, 5.0)])
def test_before_and_after_the_rows_it_stands_still(tmp_path, t: float, position: float) -> None:
    write(tmp_path, "t,a\n1,2\n3,5\n")
    assert follow(tmp_path, t).position == pytest.approx([position])


def test_a_byte_order_mark_and_blank_lines_do_no_harm(tmp_path) -> None:
    (tmp_path / "path.csv").write_bytes("\ufefft, a\r\n\r\n0,1\r\n1,2\r\n\r\n".encode())
    assert follow(tmp_path, 1.0).position == pytest.approx([2.0])


def test_mistakes_in_the_header_are_listed(tmp_path) -> None:
    problems = problems_of(tmp_path, "t,a,a,a_velocty,a_acceleration\n0,1,1,1,1\n1,1,1,1,1\n")
    assert [line.split("'")[1] for line in problems] == ["a_velocty", "b", "a", "a_acceleration"]


def test_mistakes_in_the_rows_are_listed_with_their_lines(tmp_path) -> None:
    problems = problems_of(tmp_path, "t,a,b\n0,1,2\n1,x,nan\n2,3\n")
    assert [line.split(",")[0] for line in problems] == [
        "3: column 'a' is 'x'",
        "3: column 'b' is 'nan'",
        "4: has 2 cells",
    ]


def test_time_has_to_increase(tmp_path) -> None:
    problems = problems_of(tmp_path, "t,a,b\n0,1,2\n2,1,2\n2,1,2\n1,3,3\n")
    assert [line.split(";")[0] for line in problems] == ["4: t is 2 s", "5: t is 1 s"]


def test_only_the_first_ten_of_many_mistakes_are_listed(tmp_path) -> None:
    problems = problems_of(tmp_path, "t,a,b\n" + "x,1,2\n" * 50)
    assert len(problems) == 10


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "has 0 lines"),
        (b"t,a\n0,1\n", "has 2 lines"),
        (b"\xff\xfe\x00", "cannot read .* as CSV"),
    ],
)
def test_a_file_without_a_table_is_refused(tmp_path, content: bytes, sentence: str) -> None:
    (tmp_path / "path.csv").write_bytes(content)
    with pytest.raises(WiringError, match=sentence):
        follow(tmp_path, 0.0)

"""Tables of messages of one's own types: their columns have the declared type, and their own names."""

import csv
import json
import math

import duckdb
import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as parquet
import pytest
from support.messages.recordings import write

import stepbus
from stepbus_orchestrator.cli.entry import main
from stepbus_orchestrator.errors import ExitCode
from stepbus_orchestrator.recording import Recording
from stepbus_schemas import Types

LARGE = 2**53 + 1
"""The first integer that no double holds."""
EXTREMES = [LARGE, -(2**63), 2**64 - 1]


def record(path, declaration, *rows, step_ns=10_000_000):
    """Record messages of one type as port `plant/state`; rows: their fields."""
    types = Types({"Own/1": declaration})
    messages = [types["Own/1"](**row) for row in rows]
    return write(path, step_ns, types, state=("Own/1", [], messages))


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def integers(tmp_path):
    rows = [{"i": i, "many": EXTREMES[: n + 1], "pair": [i, 1]} for n, i in enumerate(EXTREMES)]
    return record(tmp_path / "run.mcap", {"i": "int", "many": "int[k]", "pair": "int[2]"}, *rows)


def test_arrays_of_a_recording_have_every_digit_of_an_integer(integers):
    with Recording(integers) as recording:
        port = recording["plant.state"]
        assert port.i.tolist() == EXTREMES
        assert port.pair.tolist() == [[i, 1] for i in EXTREMES]
        assert recording.frame("plant.state.i")["plant.state.i"].tolist() == EXTREMES


def test_csv_has_every_digit_of_an_integer(integers, tmp_path):
    assert main(["export", str(integers), "--csv", str(tmp_path / "csv")]) == 0
    rows = rows_of(tmp_path / "csv/plant.state.csv")
    assert [int(row["i"]) for row in rows] == EXTREMES
    assert json.loads(rows[2]["many"]) == EXTREMES
    types = {row["column"]: row["type"] for row in rows_of(tmp_path / "csv/columns.csv")}
    assert (types["i"], types["many"], types["pair"]) == ("int64", "list<int64>", "list<int64>")


def test_a_file_of_all_ports_has_the_digits_of_an_integer_that_no_double_holds(integers, tmp_path):
    assert main(["export", str(integers), "--csv", str(tmp_path / "all.csv")]) == 0
    rows = [row for row in rows_of(tmp_path / "all.csv") if row["signal"] == "plant.state.i"]
    assert [int(row["text"] or float(row["value"])) for row in rows] == EXTREMES


def test_parquet_has_integers_as_int64(tmp_path):
    rows = [{"i": i, "many": [i]} for i in EXTREMES[:2]]
    path = record(tmp_path / "run.mcap", {"i": "int", "many": "int[k]"}, *rows)
    assert main(["export", str(path), "--parquet", str(tmp_path / "tables")]) == 0
    table = parquet.read_table(tmp_path / "tables/plant.state.parquet")
    assert table["i"].to_pylist() == EXTREMES[:2]
    assert table["many"].to_pylist() == [[i] for i in EXTREMES[:2]]
    assert table.schema.field("many").type == pa.list_(pa.int64())


def test_an_integer_too_large_for_parquet_loses_its_port_only(integers, tmp_path, capsys):
    assert main(["export", str(integers), "--parquet", str(tmp_path)]) == ExitCode.RECORDING
    lines = [line for line in capsys.readouterr().err.splitlines() if line]
    (line,) = lines
    assert "i has an integer above 9223372036854775807" in line


def test_integers_are_compared_digit_by_digit(tmp_path):
    one, other = (
        record(tmp_path / f"{i}.mcap", {"i": "int"}, {"i": i}) for i in (LARGE, LARGE - 1)
    )
    assert stepbus.compare(one, other)["plant.state.i"].max == 1


def test_an_absent_integer_makes_no_float_of_the_others(tmp_path):
    declaration = {"i": {"type": "int", "optional": True}}
    path = record(tmp_path / "run.mcap", declaration, {}, {"i": LARGE})
    frame = Recording(path).frame()
    assert str(frame.dtypes["plant.state.i"]) == "Int64"
    assert frame["plant.state.i"].iloc[1] == LARGE


def test_times_of_tables_are_exact_after_52_days(tmp_path):
    step_ns = 3600 * 10**9
    path = record(tmp_path / "run.mcap", {"x": "float"}, *[{"x": 0.0}] * 2100, step_ns=step_ns)
    expected = [step * step_ns for step in range(2100)]
    for form, read in (("csv", pl.read_csv), ("parquet", pl.read_parquet)):
        assert main(["export", str(path), f"--{form}", str(tmp_path)]) == 0
        assert read(tmp_path / f"plant.state.{form}")["t_ns"].to_list() == expected


def test_numbers_that_json_lacks_stay_numbers_for_readers_of_csv(tmp_path):
    odd = [math.inf, -math.inf, math.nan, 1.5]
    declaration = {"x": "float", "many": "float[k]", "table": "float[k,2]"}
    rows = [{"x": x, "many": odd, "table": [[x, 1.0]]} for x in odd]
    path = record(tmp_path / "run.mcap", declaration, *rows)
    assert main(["export", str(path), "--csv", str(tmp_path / "csv")]) == 0
    table = pl.read_csv(tmp_path / "csv/plant.state.csv")
    np.testing.assert_array_equal(table["x"], odd)
    cells = [json.loads(cell, parse_constant=pytest.fail) for cell in table["many"]]
    np.testing.assert_array_equal(np.array(cells[0], float), odd)
    np.testing.assert_array_equal(np.array(json.loads(table["table"][0]), float), [[math.inf, 1.0]])
    query = f"select many::DOUBLE[] from '{tmp_path}/csv/plant.state.csv'"
    np.testing.assert_array_equal(duckdb.sql(query).fetchall()[0][0], odd)


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_own_fields_named_like_the_clock_have_columns_of_their_own(tmp_path, capsys, form):
    row = {"t": 1.5, "step": 2, "t_ns": 3, "t_": 4.5}
    declaration = {"t": "float", "step": "int", "t_ns": "int", "t_": "float"}
    path = record(tmp_path / "run.mcap", declaration, row)
    assert main(["export", str(path), f"--{form}", str(tmp_path)]) == 0
    read = pl.read_csv if form == "csv" else pl.read_parquet
    table = read(tmp_path / f"plant.state.{form}")
    assert table.row(0, named=True) == {"step": 0, "t_ns": 0, "t": 0.0, "step_": 2, "t__": 1.5, "t_": 4.5, "t_ns_": 3}  # fmt: skip
    assert "plant/state: t is in the column t__" in capsys.readouterr().err

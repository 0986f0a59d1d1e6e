"""What pandas, polars, DuckDB and pyarrow make of a column, as docs/guide/looking/exports.md says."""

import math
from pathlib import Path

import pytest
from support.messages.recordings import write
from support.paths import DOCS

import stepbus
from stepbus_orchestrator.cli.entry import main
from stepbus_orchestrator.errors import ExitCode
from stepbus_schemas import Types

pandas = pytest.importorskip("pandas")
polars = pytest.importorskip("polars")
duckdb = pytest.importorskip("duckdb")
pa = pytest.importorskip("pyarrow")
pc = pytest.importorskip("pyarrow.compute")
pq = pytest.importorskip("pyarrow.parquet")

PAGE = DOCS / "guide/looking/exports.md"


def in_pandas(file, again, **how):
    frame = pandas.read_parquet(file, **how)
    frame.to_parquet(again)
    column = frame["x"]
    return column.count(), column.mean(), column.max(), column[column > 2].tolist()


def in_polars(file, again):
    frame = polars.read_parquet(file)
    frame.write_parquet(again)
    column = frame["x"]
    return column.count(), column.mean(), column.max(), column.filter(column > 2).to_list()


def in_duckdb(file, again):
    duckdb.sql(f"copy (select * from '{file}') to '{again}'")
    ((count, mean, most),) = duckdb.sql(f"select count(x), avg(x), max(x) from '{file}'").fetchall()
    above = duckdb.sql(f"select x from '{file}' where x > 2").fetchall()
    return count, mean, most, [value for (value,) in above]


def in_pyarrow(file, again):
    table = pq.read_table(file)
    pq.write_table(table, again)
    column = table["x"]
    some = [f(column).as_py() for f in (pc.count, pc.mean, pc.max)]
    return *some, table.filter(pc.field("x") > 2)["x"].to_pylist()


def shown(value):
    if isinstance(value, list):
        return ", ".join(map(shown, value))
    return "NaN" if value is pandas.NA or math.isnan(value) else f"{value:g}"


def test_the_page_says_how_each_reader_counts_nulls_and_nans(tmp_path):
    file, again = tmp_path / "x.parquet", tmp_path / "again.parquet"
    field = pa.field("x", pa.float64(), metadata={"unit": "rad"})
    column = pa.array([1.0, None, math.nan, 3.0])
    pq.write_table(pa.table([column], schema=pa.schema([field])), file)
    found = []
    for read in (
        in_pandas,
        lambda *files: in_pandas(*files, dtype_backend="pyarrow"),
        in_polars,
        in_duckdb,
        in_pyarrow,
    ):
        cells = list(map(shown, read(str(file), str(again))))
        metadata = pq.read_schema(again).field("x").metadata or {}
        found.append([*cells, metadata.get(b"unit", b"lost").decode()])
    rows = ("count", "mean", "maximum", "values above 2", "unit after writing it again")
    page = PAGE.read_text()
    for row, cells in zip(rows, zip(*found, strict=True), strict=True):
        assert f"| {row} | {' | '.join(cells)} |" in page


DECLARED = {
    "double": "float", "int64": "int", "bool": "bool", "string": "text", "list<double>": "float[k]"
}  # fmt: skip
FIELDS = {name: f"x{number}" for number, name in enumerate(DECLARED)}
OWN = Types(
    {
        "Own/1": {FIELDS[name]: {"type": form, "optional": True} for name, form in DECLARED.items()}
        | {"none": "float[k]"}
    }
)


def exported(folder, *rows):
    """Export messages with these fields; return the files of Parquet and of CSV."""
    messages = [OWN["Own/1"](none=[], **row) for row in rows]
    quiet = ("Own/1", [], [])
    run = write(folder / "run.mcap", 10_000_000, OWN, own=("Own/1", [], messages), quiet=quiet)
    assert main(["export", str(run), "--parquet", f"{folder}/p", "--csv", f"{folder}/c"]) == 0
    return str(folder / "p/plant.own.parquet"), str(folder / "c/plant.own.csv")


def types_of(form, file):
    """Return column → type, for each reader."""
    arrow = {"dtype_backend": "pyarrow"}
    in_pandas = [getattr(pandas, f"read_{form}")(file, **how).dtypes for how in ({}, arrow)]
    in_polars = getattr(polars, f"read_{form}")(file).schema
    found = [{name: str(kind) for name, kind in types.items()} for types in (*in_pandas, in_polars)]
    rows = duckdb.sql(f"describe select * from '{file}'").fetchall()
    return [*found, {name: kind for name, kind, *_ in rows}]


def test_the_page_says_the_type_of_a_column_without_values(tmp_path):
    page, (parquet, csv) = PAGE.read_text(), exported(tmp_path, {}, {})
    schema = pq.read_schema(parquet)
    for name, field in FIELDS.items():
        assert str(schema.field(field).type).replace("element: ", "") == name
        cells = [types[field].replace("element: ", "") for types in types_of("parquet", parquet)]
        cells = [f"`{cell.removesuffix('[pyarrow]')}`" for cell in cells]
        assert f"| `{name}` | {' | '.join(cells)} |" in page
    for row, fields in {
        "any of these, in CSV": FIELDS.values(),
        "a list that is always empty, in CSV": ["none"],
    }.items():
        for field in fields:
            cells = [types[field].removesuffix("[pyarrow]") for types in types_of("csv", csv)]
            assert f"| {row} | {' | '.join(f'`{cell}`' for cell in cells)} |" in page


def test_csv_has_an_empty_text_as_an_absent_one(tmp_path):
    text = FIELDS["string"]
    for file, absent in zip(exported(tmp_path, {text: ""}, {}, {text: "a"}), (1, 2), strict=True):
        form = file.rpartition(".")[2]
        for reader in (pandas, polars):
            assert getattr(reader, f"read_{form}")(file)[text].count() == 3 - absent
        ((count,),) = duckdb.sql(f"select count(*) from '{file}' where {text} is null").fetchall()
        assert count == absent


def test_a_port_that_never_published_has_no_table(tmp_path, capsys):
    parquet, csv = (Path(file).parent for file in exported(tmp_path, {}))
    assert [path.name for path in parquet.iterdir()] == ["plant.own.parquet"]
    assert "quiet" not in (csv / "columns.csv").read_text()
    frame = stepbus.Recording(tmp_path / "run.mcap").frame()
    assert all(column.startswith("plant.own.") for column in frame)
    empty = write(tmp_path / "empty.mcap", 10_000_000, OWN, quiet=("Own/1", [], []))
    words = ["export", str(empty), "--parquet", str(tmp_path / "none")]
    assert main(words) == ExitCode.RECORDING
    assert not (tmp_path / "none").exists()
    assert "no message that can be exported" in capsys.readouterr().err

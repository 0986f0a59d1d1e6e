"""What pandas, polars, DuckDB and pyarrow make of a column, as docs/guide/looking/exports.md says."""

import math

import pytest
from support.paths import DOCS

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

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pyarrow.parquet as parquet
import pytest

from stepbus_orchestrator.errors import RecordingFailed
from stepbus_tools.sweep.rows import TABLE_FILE, Journal, ResultRow, write_table
from stepbus_tools.sweep.run_sweep import SweepProgress


def test_the_remaining_time_is_known_once_there_is_a_rate() -> None:
    assert SweepProgress(done=4, total=80, failed=0, rate=0.2).remaining_s == pytest.approx(380)
    assert SweepProgress(done=4, total=80, failed=0).remaining_s is None


def row(run: int, **more: object) -> ResultRow:
    fields: dict[str, object] = {"values": {"a": run / 2}, "outcome": "finished", "exit_code": 0}
    return ResultRow(run=run, **{**fields, **more})  # type: ignore[arg-type]


def test_rows_are_there_again_and_half_a_line_is_not(tmp_path: Path) -> None:
    with Journal(tmp_path) as journal:
        journal.add(row(3))
        journal.add(row(1))
    path = tmp_path / "rows.jsonl"
    path.write_bytes(path.read_bytes() + b'{"run":2,"val')
    with Journal(tmp_path) as journal:
        assert 2 not in journal
        journal.add(row(2))
        assert [found.run for found in journal.values()] == [1, 2, 3]
    with Journal(tmp_path) as journal:
        assert len(journal) == 3


def test_rows_are_read_while_another_thread_writes_some(tmp_path: Path) -> None:
    with Journal(tmp_path) as journal, ThreadPoolExecutor(1) as pool:
        added = [pool.submit(journal.add, row(0))]
        added[0].result()
        added += [pool.submit(journal.add, row(number)) for number in range(1, 300)]
        while not all(future.done() for future in added):
            for number in range(len(journal)):
                assert journal[number].run == number
        assert [found.run for found in journal.values()] == list(range(300))


def test_a_damaged_line_is_named(tmp_path: Path) -> None:
    (tmp_path / "rows.jsonl").write_text("nonsense\n")
    with pytest.raises(RecordingFailed, match="byte 0 is not the start of a row"):
        Journal(tmp_path)


FULL_DISK = """
import resource, signal, sys
from pathlib import Path
from stepbus_orchestrator.errors import RecordingFailed
from stepbus_tools.sweep.rows import Journal, ResultRow

folder = Path(sys.argv[1])
fields = {"values": {}, "outcome": "finished", "exit_code": 0}
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
with Journal(folder) as journal:
    journal.add(ResultRow(run=0, **fields))
    size = (folder / "rows.jsonl").stat().st_size
    # A file that may not grow further takes a part of a row, as a full disk does.
    resource.setrlimit(resource.RLIMIT_FSIZE, (size + 10, resource.RLIM_INFINITY))
    try:
        journal.add(ResultRow(run=1, **fields))
    except RecordingFailed as exc:
        print(exc)
    print((folder / "rows.jsonl").stat().st_size - size)
    resource.setrlimit(resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    journal.add(ResultRow(run=1, **fields))
    print([found.run for found in journal.values()])
"""


def test_a_full_disk_costs_one_row(tmp_path: Path) -> None:
    words = [sys.executable, "-c", FULL_DISK, str(tmp_path)]  # the limit holds for all of it
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    sentence, grown_by, rows = done.stdout.splitlines()
    assert "all 1 earlier rows are kept" in sentence
    assert (grown_by, rows) == ("0", "[0, 1]")


def table(folder: Path, rows: list[ResultRow], paths: list[str]) -> bytes:
    folder.mkdir()
    with Journal(folder) as journal:
        for one in rows:
            journal.add(one)
        write_table(journal, paths, folder)
    return (folder / TABLE_FILE).read_bytes()


def test_the_table_depends_on_neither_order_nor_time(tmp_path: Path) -> None:
    rows = [row(n, metrics={"rmse": 0.1 * n}, sha256=f"{n}") for n in range(20)]
    others = [
        row(n, metrics={"rmse": 0.1 * n}, sha256=f"{n}", wall_s=n + 1.0, where="b", attempts=2)
        for n in reversed(range(20))
    ]
    assert table(tmp_path / "a", rows, ["a"]) == table(tmp_path / "b", others, ["a"])


def test_columns_have_the_types_of_their_values(tmp_path: Path) -> None:
    rows = [
        row(0, values={"a": 1, "b": "x"}, metrics={"success": True, "m": 1, "a": 5.0}),
        row(1, values={"a": 2.5, "b": [1, 2]}, metrics={"success": False, "m": None}),
        row(2, values={"a": 3, "b": None}, outcome="failed", exit_code=4, metric_error="it broke"),
    ]
    table(tmp_path / "t", rows, ["a", "b"])
    found = parquet.read_table(tmp_path / "t" / TABLE_FILE).to_pydict()
    assert found["run"] == [0, 1, 2]
    assert found["a"] == [1.0, 2.5, 3.0]
    assert found["b"] == ["x", "[1, 2]", None]
    assert found["success"] == [True, False, None]
    assert found["m"] == [1, None, None]
    assert found["metric.a"] == [5.0, None, None]
    assert found["exit_code"] == [0, 0, 4]
    assert found["metric_error"] == [None, None, "it broke"]


def test_axes_and_metrics_named_like_other_columns_have_columns_of_their_own(
    tmp_path: Path,
) -> None:
    metrics = {"run": 1.0, "metric.run": 2.0, "steps_": 3.0}
    table(tmp_path / "t", [row(0, values={"steps": 4}, metrics=metrics)], ["steps"])
    found = parquet.read_table(tmp_path / "t" / TABLE_FILE).to_pydict()
    assert (found["run"], found["steps"], found["steps_"]) == ([0], [0], [4])
    assert sorted(found[name][0] for name in found if name.startswith("metric.")) == [1, 2, 3]

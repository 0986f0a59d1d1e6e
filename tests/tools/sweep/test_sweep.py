"""Sweeps as a user makes them: by the command line, with Ray."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import psutil
import pyarrow.parquet as parquet
import pytest

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.errors import ExitCode

pytest.importorskip("ray")
pytestmark = pytest.mark.timeout(600)
STEPBUS = [sys.executable, "-m", "stepbus_orchestrator.cli"]
AXES = ["--vary", "controller.params.kp=50:200:3", "--vary", "controller.params.kd=10,20"]
SHORT = ["--set", "duration=100ms"]

METRIC = """
import helper

def worst(recording):
    return {"worst": helper.largest(recording["plant.joint_state"].position)}

def broken(recording):
    raise ValueError("no data")
"""


def sweep(folder: Path, *words: str, check: bool = True) -> subprocess.CompletedProcess[str]:
    command = [*STEPBUS, "sweep", *words, "--out", str(folder / "sweep")]
    # Ray's sockets need a short name; what it leaves goes with the folder.
    environment = {**os.environ, "HOME": str(folder)}
    done = subprocess.run(
        command,
        check=False,
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=280,
    )
    assert not check or done.returncode == 0, done.stderr
    return done


def run_in(folder: Path, command: Sequence[str | Path]) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "HOME": str(folder)}
    return subprocess.run(
        command, check=False, cwd=folder, env=environment, capture_output=True, text=True
    )


def rows(folder: Path) -> dict[str, list[object]]:
    found: dict[str, list[object]] = parquet.read_table(
        folder / "sweep/results.parquet"
    ).to_pydict()
    return found


@pytest.mark.slow
def test_a_sweep_is_a_table_a_page_and_runs_that_can_be_made_again(tmp_path: Path) -> None:
    (tmp_path / "my.py").write_text(METRIC)
    (tmp_path / "helper.py").write_text("def largest(values):\n    return abs(values).max()\n")
    words = ["two_link", *AXES, *SHORT, "--jobs", "1", "--keep", "all"]
    metrics = ["--metric", "my.py:worst", "--metric", "my.py:broken"]
    done = sweep(tmp_path, *words, *metrics, "--vary", "faults=none,kill controller at 5")
    assert "6 of 12 failed" in done.stdout
    told = re.findall(r"^sweep: .*$", done.stdout, re.MULTILINE)
    form = r"sweep: \d+ of 12 runs[^%]*, \d+ %(, [0-9.]+ (runs/s|s/run))?(, .+ left)?(; .+)?"
    assert all(re.fullmatch(form, line) for line in told), told
    assert "0.0 runs/s" not in done.stdout
    table = rows(tmp_path)
    assert table["run"] == list(range(12))
    assert table["controller.params.kp"] == [50] * 4 + [125] * 4 + [200] * 4
    assert table["exit_code"] == [0, 5] * 6
    assert table["success"] == [True, False] * 6
    assert all(table["worst"])
    assert "my.py:broken raised ValueError: no data" in str(table["metric_error"][0])
    assert len(set(table["sha256"][::2])) == 6
    # What stays is a recording like any other, and row 4 again is the same, in processes.
    kept = tmp_path / "sweep" / str(table["folder"][4])
    assert (kept / "run.mcap").is_file()
    again = [*STEPBUS, "rerun", str(tmp_path / "sweep"), "4", "--out", str(tmp_path / "again")]
    found = subprocess.run(
        [*again, "--json"], check=False, capture_output=True, text=True, timeout=60
    )
    assert found.returncode == 0, found.stderr
    assert json.loads(found.stdout)["result"]["sha256"] == table["sha256"][4]
    page = (tmp_path / "sweep/report.html").read_text()
    assert "kill controller at 5" in page
    # The same command has nothing to do; another sweep gets no place here.
    before = (tmp_path / "sweep/results.parquet").read_bytes()
    more = sweep(tmp_path, *words, *metrics, "--vary", "faults=none,kill controller at 5")
    assert "0 runs" in more.stdout
    assert "12 were there before" in more.stdout
    assert (tmp_path / "sweep/results.parquet").read_bytes() == before
    other = sweep(tmp_path, "two_link", *AXES, check=False)
    assert other.returncode == 2
    assert "holds another sweep" in other.stderr


@pytest.mark.parametrize(
    ("words", "sentences"),
    [
        (
            ["--vary", "controller.params.kpp=1,2", "--vary", "controller.params.kp=x"],
            ["did you mean 'kp'?", "must be a number, not 'x'"],
        ),
        (["--vary", "plant.params.gravity~normal(1, -1)"], ["no value can be drawn"]),
        (["--vary", "controler.params.kp=1,2"], ["no participant and no key 'controler'"]),
        (["--vary", "controller.params.kp=1:5"], ["a range needs a count"]),
        ([], ["needs at least one axis"]),
        (["--vary", "seed=1,2", "--metric", "no.py:f"], ["there is no file no.py"]),
        (["--vary", "seed=1,2", "--metric", "no.py"], ["write FILE.py:FUNCTION"]),
        (["--vary", "seed=1,2", "--optimize", "rmse"], ["an optimizer needs a number of runs"]),
        (
            ["--vary", "controller.params.kp=1:5", "--optimize", "rmsee", "--trials", "4"],
            ["there is no such metric; did you mean 'rmse'?", "your own with --metric"],
        ),
        (
            [
                *("--vary", "controller.params.kp=1:5", "--vary", "controler.params.kd=1,2"),
                *("--vary", "plant.params.world~nrmal(1, 2)", "--set", "durtion=1s"),
                *("--metric", "no.py:f", "--repeats", "many", "--sampling", "latn"),
            ],
            [
                "vary[0]: controller.params.kp=1:5: a range needs a count",
                "vary[1]: controler.params.kd=1,2: no participant and no key 'controler'; did you",
                "SciPy has no distribution 'nrmal'; did you mean 'normal'?",
                "--set durtion=1s: no participant and no key 'durtion'; did you mean 'duration'?",
                "metrics[0]: no.py:f: there is no file no.py",
                "repeats: must be an integer, not 'many'",
                "sampling: must be halton, latin, random or sobol, not 'latn'; did you mean",
            ],
        ),
        (
            ["--vary", "seed=1,2", "--batch", "3", "--sampling", "sobol", "--maximize"],
            ["batch: belongs to an optimizer", "sampling: no axis has", "optimize: names the"],
        ),
        (
            [
                *("--vary", "controller.params.kp=1:5", "--optimize", "rmsee"),
                *("--trials", "3", "--repeats", "2", "--samples", "5"),
            ],
            ["optimize: rmsee: there is no", "repeats: an optimizer", "samples: an optimizer"],
        ),
    ],
)
def test_a_mistake_is_one_sentence_before_anything_starts(
    tmp_path: Path,
    words: list[str],
    sentences: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["sweep", "two_link", *words, "--out", "sweep"]) == ExitCode.SCENARIO == 2
    errors = " ".join(capsys.readouterr().err.split())
    assert "Traceback" not in errors
    assert all(sentence in errors for sentence in sentences), errors
    assert not (tmp_path / "sweep/rows.jsonl").exists()


def test_all_mistakes_of_a_sweep_file_are_listed_with_their_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("mine.py").write_text("def measure(recording):\n    return 1.0\n")
    Path("sweep.yaml").write_text(
        "scenario: two_lnk\nvary: [controller.params.kp=50:200]\nsampels: 3\nrepeats: x\n"
        "metrics: ['mine.py:mesure', 'mine.py:measure']\n"
    )
    assert main(["sweep", "sweep.yaml", "--trials", "3"]) == ExitCode.SCENARIO
    errors = capsys.readouterr().err
    for sentence in (
        "optimize: names the metric that trials are for",
        "sweep.yaml:2: vary[0]: controller.params.kp=50:200: a range needs a count",
        "sweep.yaml:3: sampels: unknown key 'sampels'; did you mean 'samples'?",
        "sweep.yaml:4: repeats: must be an integer, not 'x'",
        (
            "sweep.yaml:5: metrics[0]: mine.py:mesure: mine.py has no function 'mesure'; "
            "did you mean 'measure'?"
        ),
        "two_lnk: no file, no folder and no built-in scenario of that name",
    ):
        assert sentence in errors
    assert "metrics[1]" not in errors


@pytest.mark.slow
def test_a_sweep_that_is_killed_goes_on_and_gives_the_same_table(tmp_path: Path) -> None:
    words = ["two_link", *SHORT, "--vary", "controller.params.kp~uniform(50, 100)"]
    words += ["--samples", "40", "--seed", "3"]
    (tmp_path / "whole").mkdir()
    sweep(tmp_path / "whole", *words, "--jobs", "1")
    command = [*STEPBUS, "sweep", *words, "--out", str(tmp_path / "sweep")]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=tmp_path) as process:
        family = psutil.Process(process.pid)
        journal = tmp_path / "sweep/rows.jsonl"
        wait_for(lambda: journal.exists() and journal.read_bytes().count(b"\n") >= 5)
        children = family.children(recursive=True)
        process.send_signal(signal.SIGKILL)
    _, alive = psutil.wait_procs(children, timeout=100)
    assert not alive
    mark = (tmp_path / "sweep/.reach").read_text()
    before = {json.loads(line)["run"] for line in journal.read_bytes().splitlines(keepends=True)
              if line.endswith(b"\n")}  # fmt: skip
    done = sweep(tmp_path, *words)
    assert f"{len(before)} were there before" in done.stdout
    names = ("whole/sweep/results.parquet", "sweep/results.parquet")
    assert len({(tmp_path / name).read_bytes() for name in names}) == 1
    # What the killed one has left is gone, too.
    left = mark.splitlines()[1]
    assert not Path(left).exists()


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_done(tmp_path: Path) -> None:
    command = [*STEPBUS, "sweep", "two_link", "--vary", "controller.params.kp=50:100:400"]
    command += [*SHORT, "--out", str(tmp_path / "sweep")]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        journal = tmp_path / "sweep/rows.jsonl"
        wait_for(lambda: journal.exists() and journal.read_bytes().count(b"\n") >= 3)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=200)
    assert process.returncode == 130
    assert "of 400 runs; the same command goes on from there" in errors
    assert 3 <= len(rows(tmp_path)["run"]) < 400


@pytest.mark.slow
def test_an_optimizer_asks_for_the_same_points_however_many_cores(tmp_path: Path) -> None:
    words = ["two_link", "--set", "duration=500ms", "--vary", "controller.params.kp=10:400:log"]
    words += ["--vary", "controller.params.kd=1:60", "--optimize", "rmse", "--trials", "16"]
    for jobs in ("1", "2"):
        (tmp_path / jobs).mkdir()
        sweep(tmp_path / jobs, *words, "--jobs", jobs)
    tables = [(tmp_path / jobs / "sweep/results.parquet").read_bytes() for jobs in ("1", "2")]
    assert tables[0] == tables[1]
    found = rows(tmp_path / "1")["rmse"]
    assert min(found[8:]) < min(found[:4])


@pytest.mark.slow
@pytest.mark.parametrize("keep", ["all", "none"])
def test_a_full_disk_ends_a_sweep_and_leaves_no_row_that_is_not_the_points_own(
    tmp_path: Path, small_disk: Callable[[str], Path], keep: str
) -> None:
    disk = small_disk("16m")
    filler = disk / "filler"
    left = 1_200_000 if keep == "all" else 40_000
    filler.write_bytes(bytes(16 * 1024**2 - left))
    words = ["two_link", "--set", "duration=5s", "--vary", "controller.params.kp=50:100:8"]
    command = [*STEPBUS, "sweep", *words, "--keep", keep, "--out", disk / "sweep"]
    done = run_in(tmp_path, command)
    assert done.returncode == ExitCode.RECORDING, done.stderr
    assert "No space left on device" in done.stderr
    journal = (disk / "sweep/rows.jsonl").read_bytes().splitlines()
    assert all(json.loads(line)["exit_code"] == 0 for line in journal)
    filler.unlink()
    done = run_in(tmp_path, command)
    assert done.returncode == 0, done.stderr
    table = parquet.read_table(disk / "sweep/results.parquet").to_pydict()
    assert table["exit_code"] == [0] * 8


@pytest.mark.slow
def test_with_a_umask_of_0_nobody_else_may_write_to_what_a_sweep_leaves(tmp_path: Path) -> None:
    words = ["two_link", *SHORT, "--vary", "controller.params.kp=50,100", "--keep", "all"]
    command = [*STEPBUS, "sweep", *words, "--out", str(tmp_path / "sweep")]
    environment = {**os.environ, "HOME": str(tmp_path)}
    subprocess.run(command, check=True, cwd=tmp_path, env=environment, umask=0, capture_output=True)
    found = [tmp_path / "sweep", *(tmp_path / "sweep").rglob("*")]
    assert len(found) > 20
    assert [str(path) for path in found if path.stat().st_mode & 0o002] == []


TIP = """
def measure(recording):
    return {"tip_error": 0.5, "verdict": "fine"}
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("tip_eror", "it is no metric of these runs; did you mean 'tip_error'?"),
        ("settling", "it is None in run 0, which is no number"),
        ("verdict", "it is 'fine' in run 0, which is no number"),
        ("rmse.joint3", "it is no metric of these runs"),
    ],
)
def test_an_optimizer_ends_where_there_is_nothing_to_optimise(
    tmp_path: Path, name: str, sentence: str
) -> None:
    (tmp_path / "measure.py").write_text(TIP)
    words = ["two_link", *SHORT, "--vary", "controller.params.kp=10:400", "--trials", "32"]
    words += ["--optimize", name, "--metric", "measure.py:measure", "--out", "sweep"]
    command = [*STEPBUS, "sweep", *words]
    done = run_in(tmp_path, command)
    assert done.returncode == 2
    assert " ".join(sentence.split()) in " ".join(done.stderr.split())
    assert 0 < (tmp_path / "sweep/rows.jsonl").read_bytes().count(b"\n") < 32


@pytest.mark.slow
def test_a_run_that_takes_too_long_is_a_row(tmp_path: Path) -> None:
    words = ["two_link", "--vary", "duration=100ms,2000s", "--timeout", "20s", "--jobs", "2"]
    sweep(tmp_path, *words)
    table = rows(tmp_path)
    assert table["outcome"] == ["finished", "timed out"]
    assert table["reason"][1] == "it took longer than 20 s"


FLAKY = """
import os, pathlib, stepbus

class Flaky(stepbus.Participant):
    def start(self, inputs):
        mark = pathlib.Path(self.config.param("mark") + str(self.config.param("number")))
        if self.config.param("number") and not mark.exists():
            mark.touch()
            os._exit(3)

raise SystemExit(stepbus.main(Flaky))
"""


@pytest.mark.slow
def test_what_a_machine_may_have_failed_is_repeated_and_values_vary_together(
    tmp_path: Path,
) -> None:
    (tmp_path / "flaky.py").write_text(FLAKY)
    (tmp_path / "s.yaml").write_text(
        "extends: two_link\nname: flaky\nduration: 50ms\nparticipants:\n  flaky:\n"
        "    exec: [python, flaky.py]\n    inputs: {joint_state: plant.joint_state}\n"
        f"    params: {{mark: {tmp_path}/mark, number: 0}}\n"
    )
    axis = "flaky.params.number=0,1,2 & controller.params.kp=50,60,70"
    words = ["s.yaml", "--vary", axis, "--jobs", "1", "--keep", "none"]
    sweep(tmp_path, *words, "--retry", "1")
    table = rows(tmp_path)
    assert table["exit_code"] == [0, 0, 0]
    assert table["controller.params.kp"] == [50, 60, 70]
    times = parquet.read_table(tmp_path / "sweep/times.parquet").to_pydict()
    assert times["attempts"] == [1, 2, 2]
    # Without, they are rows with their cause; and Python has the same sweep.
    for mark in tmp_path.glob("mark*"):
        mark.unlink()
    text = (
        "import stepbus; "
        f"done = stepbus.sweep('s.yaml', [{axis!r}], jobs=1, keep='none', out='plain'); "
        "print(done.failed, dict(done.causes), done.table()['exit_code'].to_pylist())"
    )
    found = subprocess.run(
        [sys.executable, "-c", text], cwd=tmp_path, capture_output=True, text=True, timeout=100,
        check=False, env={**os.environ, "HOME": str(tmp_path)},
    )  # fmt: skip
    assert found.returncode == 0, found.stderr
    cause = {"failed (flaky), exit code 5": 2}
    assert found.stdout.strip() == f"2 {cause} [0, 5, 5]", found.stdout


@pytest.mark.slow
def test_a_node_that_dies_costs_only_its_runs(tmp_path: Path) -> None:
    words = ["two_link", *SHORT, "--vary", "controller.params.kp=50:100:60"]
    (tmp_path / "whole").mkdir()
    sweep(tmp_path / "whole", *words, "--jobs", "1")
    script = Path(__file__).parent / "programs" / "losing_a_node.py"
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path / "sweep"), *words[1:]],
        check=False, cwd=tmp_path, capture_output=True, text=True, timeout=280,
        env={**os.environ, "HOME": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    names = ("whole/sweep/results.parquet", "sweep/results.parquet")
    assert len({(tmp_path / name).read_bytes() for name in names}) == 1


@pytest.mark.slow
def test_other_users_of_the_machine_get_nothing_of_a_sweep(tmp_path: Path) -> None:
    words = [*STEPBUS, "sweep", "two_link", "--vary", "controller.params.kp=50:100:200"]
    mark, journal = tmp_path / "sweep/.reach", tmp_path / "sweep/rows.jsonl"
    environment = {**os.environ, "HOME": str(tmp_path)}
    answer = "refused: nobody but root can try"
    # Planted by somebody who may write there: neither followed nor believed.
    planted, kept = tmp_path / "planted", tmp_path / "stepbus-ray-kept"
    planted.write_text(f"mine\n{kept}\n")
    kept.mkdir()
    mark.parent.mkdir()
    mark.symlink_to(planted)
    with subprocess.Popen(
        [*words, "--jobs", "1", "--out", str(tmp_path / "sweep")],
        cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    ) as process:  # fmt: skip
        try:
            wait_for(lambda: journal.exists() and journal.stat().st_size > 0)
            family = [psutil.Process(process.pid), *psutil.Process(process.pid).children(True)]
            listening = {
                found.laddr.ip.removeprefix("::ffff:")
                for member in family
                for found in member.net_connections("inet")
                if found.status == psutil.CONN_LISTEN
            }
            secrets = {member.environ().get("RAY_AUTH_TOKEN", "") for member in family} - {""}
            said = " ".join(word for member in family for word in member.cmdline())
            content, mode = mark.read_text(), mark.stat().st_mode & 0o777
            private = Path(content.splitlines()[1])
            modes = mode, private.stat().st_mode & 0o777
            if os.getuid() == 0:  # only root can become another user
                for attempt in (["cat", mark], ["ls", private], ["ls", private / "r"]):
                    assert subprocess.run(attempt, user=65534, check=False).returncode != 0
                (address,) = {
                    word.partition("=")[2] for word in said.split() if "--gcs-address=" in word
                }
                # Ray replaces 127.0.0.1 by the machine's own address, where nothing listens.
                answer = as_another_user(
                    tmp_path, f"[::ffff:127.0.0.1]:{address.rpartition(':')[2]}"
                )
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(60)
    assert listening == {"127.0.0.1"}
    assert answer.startswith("refused"), answer
    assert modes == (0o600, 0o700)
    (secret,) = secrets
    assert secret not in content
    assert secret not in said
    assert not private.exists()
    assert (planted.read_text(), kept.is_dir()) == (f"mine\n{kept}\n", True)


CLIENT = """
import sys, ray
try:
    ray.init(address=sys.argv[1], log_to_driver=False)
    print("ran as", ray.get(ray.remote(__import__("os").getuid).remote(), timeout=60))
except Exception as exc:
    print("refused", exc)
"""


def as_another_user(folder: Path, address: str) -> str:
    """Return what a Ray client of another user gets, with a token that it has guessed."""
    minor = f"python3.{sys.version_info.minor}"
    packages = str(Path(psutil.__file__).parents[1])
    guessed = {"HOME": str(folder), "PYTHONPATH": packages, "RAY_AUTH_MODE": "token",
               "RAY_AUTH_TOKEN": "a" * 32}  # fmt: skip
    for python in (sys.executable, f"/usr/bin/{minor}"):
        with contextlib.suppress(PermissionError, FileNotFoundError):
            done = subprocess.run(
                [python, "-c", CLIENT, address], user=65534, group=65534, extra_groups=[],
                env=guessed, capture_output=True, text=True, timeout=200, check=False, cwd="/",
            )  # fmt: skip
            return done.stdout.strip() or done.stderr
    return "refused: it has no Python that it may start"


def wait_for(holds: object) -> None:
    assert callable(holds)
    end = time.monotonic() + 250
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.02)

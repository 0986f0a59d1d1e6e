"""What others have put into the folder of a run, and what the run leaves them to change."""

import os
import socket
import stat
import subprocess
import sys

import pytest

from stepbus_orchestrator.cli import main

pytestmark = pytest.mark.slow

COMMAND = [sys.executable, "-m", "stepbus_orchestrator.cli"]
PLANTED = [
    ".result.json.part",
    ".report.png.part",
    ".report.html.part",
    ".run.mcap.reserve",
    ".timing.mcap.reserve",
    "result.json",
    "profile/mission.csv",
]


def run(scenario, out, *words, umask=0o022):
    command = [*COMMAND, "run", scenario, "--out", out, "--set", "duration=100ms", *words]
    return subprocess.run(
        command, umask=umask, capture_output=True, text=True, check=False, timeout=60
    )


def test_links_that_others_have_planted_are_not_followed(tmp_path):
    victim, out = tmp_path / "victim", tmp_path / "out"
    victim.mkdir()
    out.mkdir(mode=0o777)
    out.chmod(0o777)
    for name in PLANTED:
        if "/" not in name:
            (victim / name).write_text("precious")
            (out / name).symlink_to(victim / name)
    done = run("two_link", out, "--in-process", "--set", "checkpoint=50ms")
    assert done.returncode == 0, done.stderr
    assert f"{out} is writable by every user" in done.stdout
    kept = {
        path.name: (path.read_text(), stat.S_IMODE(path.stat().st_mode))
        for path in victim.iterdir()
    }
    assert set(kept.values()) == {("precious", 0o644)}
    assert not (out / "result.json").is_symlink()


@pytest.mark.parametrize("name", ["run.mcap", "timing.mcap", "logs", "checkpoints"])
def test_a_planted_link_in_the_place_of_what_a_run_makes_is_refused(tmp_path, name):
    victim, out = tmp_path / "victim", tmp_path / "out"
    victim.mkdir()
    out.mkdir()
    (out / name).symlink_to(victim / "new" if "." in name else victim)
    done = run("two_link", out, "--in-process", "--set", "checkpoint=50ms")
    assert done.returncode == (8 if name == "checkpoints" else 2), done.stdout
    assert "Traceback" not in done.stderr
    assert list(victim.iterdir()) == []


@pytest.mark.slow
def test_with_a_umask_of_0_nobody_else_may_write_to_what_a_run_leaves(tmp_path):
    out = tmp_path / "runs" / "here" / "out"
    done = run("two_link", out, "--set", "checkpoint=50ms", "--profile", umask=0)
    assert done.returncode == 0, done.stderr
    again = [*COMMAND, "rerun", out, "--out", tmp_path / "again" / "out"]
    assert subprocess.run(again, umask=0, check=False, capture_output=True).returncode == 0
    found = [
        p for base in ("runs", "again") for p in (tmp_path / base, *(tmp_path / base).rglob("*"))
    ]
    assert len(found) > 20
    assert [str(path) for path in found if path.stat().st_mode & stat.S_IWOTH] == []


def pipe(path):
    os.mkfifo(path)


def link(path):
    path.symlink_to(path.with_name("victim"))


def device(path):
    if os.geteuid() != 0:
        pytest.skip("only root makes devices")
    os.mknod(path, 0o666 | stat.S_IFCHR, os.makedev(1, 3))


def unix_socket(path):
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


def folder(path):
    path.mkdir()


@pytest.mark.parametrize("odd", [pipe, link, device, unix_socket, folder])
@pytest.mark.parametrize(
    "words",
    [
        ["report", "{run}", "--out", "{out}"],
        ["plot", "{run}", "plant.joint_state", "--out", "{out}"],
        ["export", "{run}", "--csv", "{out}"],
        ["export", "{run}", "--parquet", "{out}"],
        ["export", "{run}", "--ros2", "{out}"],
        ["export", "{run}", "--scene", "{out}"],
        ["recover", "{run}", "--out", "{out}"],
        ["replay", "{run}", "--participant", "controller", "--update", "{out}"],
    ],
)
def test_no_output_takes_the_place_of_what_is_no_file(
    tmp_path, capsys, monkeypatch, two_link_recording, odd, words
):
    monkeypatch.chdir(tmp_path)
    ending = {"--csv": "csv", "--parquet": "parquet", "plot": "png"}
    suffix = next((ending[word] for word in words if word in ending), "mcap")
    out = tmp_path / f"o.{suffix}"
    odd(out)
    before = out.lstat()
    code = main([word.format(run=two_link_recording, out=out) for word in words])
    error = capsys.readouterr().err
    assert code in {2, 8}, error
    assert "Traceback" not in error
    after = out.lstat()
    assert (after.st_mode, after.st_ino) == (before.st_mode, before.st_ino)
    assert [path.name for path in tmp_path.iterdir()] == [out.name]

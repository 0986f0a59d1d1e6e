"""Runs in several threads of one process: none disturbs another."""

from concurrent.futures import ThreadPoolExecutor

import pytest

import stepbus

SHORT = {"duration": "200ms"}


@pytest.fixture(autouse=True)
def in_its_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_run_in_one_process_takes_the_main_thread(tmp_path):
    with ThreadPoolExecutor(1) as pool:
        refused = pool.submit(stepbus.run, "two_link", out=tmp_path / "run", in_process=True)
        with pytest.raises(stepbus.WiringError, match="takes the main thread"):
            refused.result()
    assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_runs_in_separate_processes_go_on_beside_each_other():
    alone = stepbus.run("two_link", set=SHORT, out="alone").sha256

    def run(number):
        return stepbus.run("two_link", set=SHORT, out=f"{number}").sha256

    with ThreadPoolExecutor(2) as pool:
        assert set(pool.map(run, range(4))) == {alone}

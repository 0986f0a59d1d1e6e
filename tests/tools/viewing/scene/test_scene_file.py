"""`stepbus export --scene`: one file, offline."""

import pytest
from support.browser import needs_chromium, opened

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.run.hosts import InProcess
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    out = tmp_path_factory.mktemp("scene_file") / "run"
    scenario = load("two_link", ["duration=300ms"])
    return run(scenario, Options(out=out, host=InProcess())).recording


@pytest.fixture(scope="module")
def scene_file(recording):
    target = recording.with_name("scene.html")
    assert main(["export", str(recording), "--scene", str(target)]) == 0
    return target


def test_the_file_is_whole_and_small(scene_file):
    text = scene_file.read_text()
    assert "__VISER_EMBED_DATA__" in text
    assert len(text) < 2_000_000


@pytest.mark.slow
@needs_chromium
@pytest.mark.timeout(900)
def test_the_file_shows_the_arm_offline(scene_file):
    with opened(scene_file.as_uri()) as watched:
        watched.wait(lambda: watched.colours() > 300, "the arm to be drawn")
    assert not watched.errors
    assert not watched.strangers


def test_a_recording_without_messages_gives_a_sentence(recording, tmp_path, capsys):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recording.read_bytes()[:3000])
    assert main(["export", str(cut), "--scene", str(tmp_path / "scene.html")]) != 0
    assert "no scene to show: it has no messages" in capsys.readouterr().err
    assert not (tmp_path / "scene.html").exists()

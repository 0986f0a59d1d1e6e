"""What the command line says of a word that it does not know."""

from __future__ import annotations

import pytest

from stepbus_orchestrator.cli import main


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["runn", "two_link"], "'view'); did you mean 'run'?"),
        (["run", "two_link", "--transport", "tpc"], "'tcp'); did you mean 'tcp'?"),
        (["run", "two_link", "--windw", "3"], "arguments: --windw 3; did you mean '--window'?"),
        (["sweep", "two_link", "--sampels", "3"], "--sampels 3; did you mean '--samples'?"),
        (["sweep", "two_link", "--timeout", "-1"], "'-1' is no number of seconds above 0, e.g. 60"),
        (["run", "two_link", "--pause-at", "-1"], "'-1' is not a step, from 0 on"),
        (["run", "two_link", "--window", "x"], "'x' is not a number of steps, from 1 on"),
    ],
)
def test_a_word_that_no_command_knows_is_told_the_nearest(words, sentence, capsys):
    with pytest.raises(SystemExit):
        main(words)
    assert sentence in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["validate", "two_link", "--set", "kp=80"], "did you mean controller.params.kp?"),
        (["validate", "two_link", "--set", "controller.kp=80"], "write it as params.kp"),
        (["validate", "two_link", "--set", "controller.evry=2"], "did you mean 'every'?"),
        (["report", "nofile"], "No such file or directory; give the folder of a run, e.g. runs/"),
        (["report", "."], "No such file or directory; . is no folder of a run"),
    ],
)
def test_what_is_not_there_is_told_with_what_to_give(
    words, sentence, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert main(words) != 0
    assert sentence in " ".join(capsys.readouterr().err.split())

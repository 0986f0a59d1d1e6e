"""What the command line says of a word that it does not know."""

from __future__ import annotations

import pytest

from stepbus_orchestrator.cli import main


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (
            ["runn", "two_link"],
            "stepbus: no command 'runn'; did you mean 'run'? see stepbus --help",
        ),
        (["run", "two_link", "--transport", "tpc"], "'tcp'); did you mean 'tcp'?"),
        (["run", "two_link", "--windw", "3"], "unknown option --windw; did you mean '--window'?"),
        (["sweep", "two_link", "--sampels", "3"], "--sampels; did you mean '--samples'?"),
        (["run", "--jsno"], "unknown option --jsno; did you mean '--json'? see stepbus run --help"),
        (["run", "two_link", "--durration", "3s"], "did you mean '--set duration=VALUE'?"),
        (["sweep", "two_link", "--seeed=3"], "unknown option --seeed; did you mean '--seed'?"),
        (["info", "runs/a", "--josn"], "unknown option --josn; did you mean '--json'?"),
        (["run", "--json"], "the following arguments are required: scenario"),
        (["ru", "two_link"], "did you mean 'run'?"),
        (["--json", "run"], "--json is not an option of stepbus; write options after the"),
        (["run", "two_link", "--windw", "3"], "see stepbus run --help"),
        (
            ["sweep", "two_link", "--timeout", "60"],
            "'60' is not a duration; write a number with a unit",
        ),
        (["join", "ticket", "--wait", "1 year"], "'1 year' is not a duration; write a number"),
        (["run", "two_link", "--join-timeout", "0s"], "'0s' must be longer than 0"),
        (["run", "two_link", "--pause-at", "soon"], "nor a time such as 6s"),
        (
            ["run", "two_link", "--pause-at", "-1"],
            "'-1' is neither a step (0 or higher) nor a time",
        ),
        (["run", "two_link", "--window", "x"], "'x' is not a number of steps (1 or more)"),
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
        (["report", "."], "No such file or directory; . is not the folder of a run"),
    ],
)
def test_what_is_not_there_is_told_with_what_to_give(
    words, sentence, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert main(words) != 0
    assert sentence in " ".join(capsys.readouterr().err.split())

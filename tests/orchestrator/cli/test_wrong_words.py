"""What the command line says of words and files that it cannot use."""

from __future__ import annotations

import pytest

from stepbus_orchestrator.cli import main


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["run", "two_link", "--transport", "tpc"], 'Did you mean "tcp"?'),
        (["sweep", "two_link", "--sampels", "3"], "--sampels. Did you mean --samples?"),
        (["run", "two_link", "--durration", "3s"], "Did you mean '--set duration=VALUE'?"),
        (["sweep", "two_link", "--seeed=3"], "Did you mean --seed?"),
        (["info", "runs/a", "--josn"], "Did you mean --json?"),
        (["run", "--json"], "SCENARIO is missing"),
        (["info", "runs/a", "runs/b"], "too many arguments: runs/b"),
        (["join", "ticket", "--wait", "1 year"], "'1 year' is not a duration"),
        (["--json", "run"], "--json is not an option of stepbus"),
        (["validate", "two_link", "--set", "controller.kp=80"], "write it as params.kp"),
        (["report", "."], "is not the folder of a run"),
        (["run", "two_link", "--join-timeout", "1s"], "participants with `start: external`"),
        (["run", "two_link", "--view", "--pause-at", "-1"], "'-1'"),
        (["run", "two_link", "--out", "/proc/no/such"], "cannot create folder"),
        (["validate", "/no/such/file.yaml"], "/no/such/file.yaml"),
        (["describe", "/dev/null"], "/dev/null"),
        (["new", "/proc/no/such"], "cannot be written"),
        (["diff", "/dev/null", "/dev/null"], "/dev/null"),
    ],
)
def test_what_is_not_there_is_told_with_what_to_give(
    words, sentence, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit, match=r"[^0]"):
        raise SystemExit(main(words))
    said = " ".join(capsys.readouterr().err.split())
    assert sentence in said
    assert "Traceback" not in said

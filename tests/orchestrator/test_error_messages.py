"""The errors that users of the command line meet most, word for word, to be reviewed as one text.

Elsewhere, tests look for key words and numbers only.
"""

import re
import shlex

import pytest

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.scenario.locate import locate

RUN = "run two_link --set"
ERRORS = [
    ("runn two_link", "no command 'runn'; did you mean 'run'? see stepbus --help"),
    ("run two_lonk", "two_lonk: no such file, folder or built-in scenario (give the path of your own, e.g. ./my_robot/scenario.yaml); did you mean 'two_link'?"),
    ("run two_link --windw 3", "Unknown option: --windw. Did you mean --window? see stepbus run --help"),
    ("run two_link --view --pause-at soon", "'soon' is not a duration; write a number with a unit (ns, us, ms, s, min or h), e.g. 5ms"),
    ("sweep two_link --timeout 60", "Invalid value for --timeout: '60' is not a duration; write a number with a unit (ns, us, ms, s, min or h), e.g. 5ms; see stepbus sweep --help"),
    (f"{RUN} kp=80", "--set kp=80: no participant or key 'kp'; did you mean controller.params.kp?"),
    (f"{RUN} duration=10.001s", "--set duration=10.001s: duration: 10.001s is 2000.2 steps of 5ms, not a whole number; the nearest is 10s or 10005ms"),
    (f"{RUN} plant.evry=2", "--set plant.evry=2: participants.plant.evry: unknown key 'evry'; did you mean 'every'?"),
    (f"{RUN} plant.publishes=last", "scenario.yaml:16: participants.controller.inputs.joint_state: algebraic loop plant → controller → plant: each waits for another's output of the same step; give one of these inputs `delay: 1`, or set `publishes: first` for one that publishes its state before it reads its inputs, as a plant does"),
    (f"{RUN} plant.inputs.command=controler.command", "--set plant.inputs.command=controler.command: participants.plant.inputs.command: no participant 'controler'; did you mean 'controller'?"),
    (f"{RUN} controller.outputs.command=JointCommand/9", "--set controller.outputs.command=JointCommand/9: participants.controller.outputs.command: unknown message type 'JointCommand/9'; did you mean 'JointCommand/1'?"),
    (f"{RUN} controller.params.law=pidd", "--set controller.params.law=pidd: participants.controller.params.law: must be computed_torque, pd, pd_gravity, pid or file.py:Class, not 'pidd'; did you mean 'pid'?"),
    (f"{RUN} plant.params.world=wrld.yaml", "--set plant.params.world=wrld.yaml: participants.plant.params.world: file 'wrld.yaml' not found (TWO_LINK/wrld.yaml)"),
    (f"{RUN} controller.exec=[no_such]", "--set controller.exec=[no_such]: participants.controller.exec: no program 'no_such' on PATH, nor in TWO_LINK; is it installed, or to be built?"),
    ("run two_link --fault 'kil plant at 3'", "--fault kil plant at 3: faults[0]: unknown fault type 'kil'; did you mean 'kill'?"),
    ("run two_link --fault 'kill plant at 3' --in-process", "'kill plant at 3': a process fault needs a separate process; omit --in-process"),
    ("run two_link --fault 'kill controller at 5'", "step 5 (t = 0.025 s): controller (pid N) was killed by SIGKILL; its log: FOLDER/logs/controller.log"),
    ("run two_link --debug plnt", "no participant 'plnt' to debug; did you mean 'plant'?"),
    ("run tabs.yaml", "tabs.yaml:2: not YAML: found character '\\t' that cannot start any token; check the indentation, brackets and quotes"),
    ("report nowhere", "nowhere cannot be read: No such file or directory; give the folder of a run, e.g. runs/two_link-20260101-120000, or its run.mcap"),
    ("info notes.mcap", "notes.mcap is not an MCAP recording: it does not start with its magic bytes"),
    ("replay RECORDING --participant controler", "RECORDING has no participant 'controler'; did you mean 'controller'?"),
    ("branch RECORDING --at 999", "step 999 is past the end of RECORDING (60 complete steps)"),
    ("recover RECORDING --out notes.mcap", "notes.mcap already exists; choose another name with --out"),
    ("call . plant position", "no live run in .; give the folder of one, e.g. runs/two_link-20260101-120000"),
    ("help brnch", "no command 'brnch'; did you mean 'branch'? see stepbus --help"),
    ("new .", ". is not empty; choose a new folder"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "error"), ERRORS)
def test_a_mistake_is_this_one_line(
    tmp_path, monkeypatch, capsys, two_link_recording, words, error
):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "1000")
    (tmp_path / "tabs.yaml").write_text("name: a\n\tstep: 5ms\n")
    (tmp_path / "notes.mcap").write_text("these are no messages")
    with pytest.raises(SystemExit) as ended:
        raise SystemExit(main(shlex.split(words.replace("RECORDING", str(two_link_recording)))))
    assert ended.value.code
    said = re.sub(r"pid \d+", "pid N", capsys.readouterr().err)
    said = re.sub(r"log: .*/runs/[^/]*", "log: FOLDER", said)
    said = said.replace(str(locate("two_link").parent), "TWO_LINK")
    assert said.replace(str(two_link_recording), "RECORDING") == f"stepbus: {error}\n"

"""`types` of a scenario: where they come from, what is wrong with them, what is recorded."""

import sys

import pytest

from stepbus_orchestrator.errors import ScenarioError
from stepbus_orchestrator.scenario.load import load
from stepbus_orchestrator.scenario.resolve import resolved

SCENARIO = """\
name: own
step: 5ms
types: {types}
participants:
  sender:
    exec: [python, -c, pass]
    outputs: {{out: {output}}}
    on_fault: {{hold: 10ms, safe: {{out: {safe}}}}}
"""
FILE = """\
types:
  Thruster/1:
    thrust: {type: "float[n]", unit: N}
  Unused/1: {a: float}
"""


def write(folder, types, output="Thruster/1", safe="{thrust: [0.0]}", file=FILE):
    (folder / "types.yaml").write_text(file)
    text = SCENARIO.format(types=types, output=output, safe=safe)
    (folder / "scenario.yaml").write_text(text)
    return folder / "scenario.yaml"


def problems(*arguments, **keywords):
    with pytest.raises(ScenarioError) as caught:
        load(write(*arguments, **keywords))
    return str(caught.value).splitlines()


INLINE = "{Thruster/1: {thrust: 'float[n]'}, Unused/1: {a: float}}"


@pytest.mark.parametrize("types", ["types.yaml", "[types.yaml]", INLINE, f"[{INLINE}]"])
def test_types_come_from_a_file_the_scenario_or_a_list_and_those_of_ports_are_kept(tmp_path, types):
    scenario = load(write(tmp_path, types))
    assert list(scenario.types.declarations) == ["Thruster/1"]
    assert scenario.types["Thruster/1"](thrust=[1.0]).thrust == [1.0]


@pytest.mark.parametrize("types", ["types.yaml", INLINE])
def test_the_resolved_scenario_beside_the_same_files_is_the_same(tmp_path, types):
    scenario = load(write(tmp_path, types))
    text = resolved(scenario)
    (tmp_path / "scenario.yaml").write_text(text)
    again = load(tmp_path)
    assert (again, resolved(again)) == (scenario, text)


def test_types_come_from_message_classes_of_a_module(tmp_path, monkeypatch):
    (tmp_path / "own_messages.py").write_text(
        "import stepbus\n"
        "class Thruster(stepbus.Message, frozen=True):\n"
        '    """Commands."""\n'
        "    thrust: list[float]\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    try:
        scenario = load(write(tmp_path, "own_messages"))
    finally:
        sys.modules.pop("own_messages", None)
    assert scenario.types.declarations == {
        "Thruster/1": {"help": "Commands.", "thrust": {"type": "float[k]"}}
    }
    # A rerun does not need the module.
    assert 'type: "float[k]"' in resolved(scenario)


def test_all_mistakes_are_listed_with_file_and_line(tmp_path):
    file = (
        "types:\n  Thruster/1:\n    thrust: {type: 'flot[n]', units: N}\n"
        "  Imu/1: {a: float}\n  Good/1: {a: float}\nother: 1\n"
    )
    starts = [
        "scenario.yaml:8: participants.sender.on_fault: hold cannot",
        "types.yaml:3: types.Thruster/1.thrust.units: unknown key 'units'",
        "types.yaml:3: types.Thruster/1.thrust.type: must be float, int, bool",
        "types.yaml:4: types.Imu/1: Imu/1 ships with stepbus",
        "types.yaml:6: other: unknown key",
    ]
    found = problems(tmp_path, "types.yaml", output="{type: Thruster/1, bulk: true}", file=file)
    assert len(found) == len(starts)
    assert [line.startswith(start) for line, start in zip(found, starts, strict=True)] == [
        True
    ] * len(starts)


def test_a_mistake_in_the_scenario_itself_has_its_line(tmp_path):
    (found,) = problems(tmp_path, "{Thruster/1: {thrust: {type: float, min: 1}}}")
    assert found.startswith("scenario.yaml:3: types.Thruster/1")


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("raise SystemExit(3)", "SystemExit: 3"),
        ("a = = b", "SyntaxError: invalid syntax"),
    ],
)
def test_a_module_that_fails_is_a_mistake(tmp_path, monkeypatch, code, reason):
    (tmp_path / "broken_messages.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    (found,) = problems(tmp_path, "broken_messages")
    text = "types: cannot import the message type module 'broken_messages'"
    assert found.startswith(f"scenario.yaml:3: {text}: {reason}")


@pytest.mark.parametrize(
    ("types", "sentence"),
    [
        ("missing.yaml", "file 'missing.yaml' not found"),
        ("[types.yaml, no_module]", "module 'no_module'"),
        ("json", "the module 'json' has no message class"),
        ("[types.yaml, {Thruster/1: {a: int}}]", "types[1]: Thruster/1 is declared twice"),
        ("3", "must be text, a map or a list"),
    ],
)
def test_a_source_that_has_no_types_has_its_sentence(tmp_path, types, sentence):
    assert sentence in "\n".join(problems(tmp_path, types))


def test_an_unknown_type_names_its_other_versions(tmp_path):
    (found,) = problems(tmp_path, "types.yaml", output="Thruster/2")
    assert found.endswith("type 'Thruster/2'; did you mean 'Thruster/1'?")


MODES = "types: {Thruster/1: {mode: [idle, full]}}"


@pytest.mark.parametrize(
    ("safe", "file", "sentence"),
    [
        ("{thrust: 3}", FILE, "thrust: Expected `array`, got `int`"),
        ("{thrust: [3], trust: [3]}", FILE, "field 'trust'; did you mean 'thrust'?"),
        ("{mode: ful}", MODES, "idle, not 'ful'; did you mean 'full'?"),
    ],
)
def test_a_safe_message_is_checked_against_its_type(tmp_path, safe, file, sentence):
    (found,) = problems(tmp_path, "types.yaml", safe=safe, file=file)
    assert sentence in found

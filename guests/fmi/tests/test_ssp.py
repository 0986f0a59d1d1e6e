"""Systems of FMUs (SSP) run as a hand-written loop over FMPy's calls does."""

import json
import subprocess
import sys

import fmus
import pytest
from stepbus_fmi.files import ssp_scenario

import stepbus
from stepbus_schemas import WiringError

BLOCK = """
class Block(Fmi2Slave):
    def __init__(self, **options):
        super().__init__(**options)
        self.x = self.u = 0.0
        self.k, self.y = 2.0, 1.0
        self.n_in, self.n, self.b_in, self.b, self.s = 0, 1, False, True, "as it was"
        read, shown = {"causality": Fmi2Causality.input}, {"causality": Fmi2Causality.output}
        self.register_variable(Real("u", start=0.0, **read))
        self.register_variable(Real("y", **shown))
        rare = {"variability": Fmi2Variability.discrete}
        self.register_variable(Integer("n_in", start=0, **read, **rare))
        self.register_variable(Boolean("b_in", start=False, **read, **rare))
        self.register_variable(Integer("n", **shown, **rare))
        self.register_variable(Boolean("b", **shown, **rare))
        self.register_variable(Real("x", causality=Fmi2Causality.local))
        fixed = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.fixed}
        self.register_variable(Real("k", start=2.0, **fixed))
        self.register_variable(String("s", start="as it was", **fixed))

    def do_step(self, time, h):
        self.x += h * (self.k * self.u - self.x) + 0.01
        self.y = self.x + 1.0
        self.n = (self.n_in + 1) % 5
        self.b = not self.b_in
        return True
"""
LOOP = """
import json, sys
from fmpy import extract, instantiate_fmu, read_model_description

path, blocks, wires, steps, h = json.loads(sys.argv[1])
description = read_model_description(path)
refs = {v.name: v.valueReference for v in description.modelVariables}
made = {}
for name, start in blocks.items():
    made[name] = fmu = instantiate_fmu(extract(path), description, "CoSimulation")
    fmu.setupExperiment(startTime=0.0)
    for key, value in start.items():
        fmu.setReal([refs[key]], [value])
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
rows = []
for step in range(steps):
    rows.append({n: f.getReal([refs["y"]])[0].hex() for n, f in made.items()})
    got = [made[s].getReal([refs[y]])[0] for s, y, *_ in wires]
    for value, (_, _, target, u, factor, offset) in zip(got, wires):
        made[target].setReal([refs[u]], [value * factor + offset])
    for fmu in made.values():
        fmu.doStep(step * h, h)
print(json.dumps(rows))
"""
NAMES = {"ssd": "Description", "ssc": "Common", "ssv": "ParameterValues", "ssm": "ParameterMapping"}
NAMESPACES = " ".join(
    f'xmlns:{short}="http://ssp-standard.org/SSP1/SystemStructure{name}"'
    for short, name in NAMES.items()
)


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    """Return the bytes of an FMU."""
    return fmus.build(tmp_path_factory.mktemp("block"), BLOCK).read_bytes()


def ssd(system, root=""):
    return (
        f'<ssd:SystemStructureDescription {NAMESPACES} version="2.0" name="made">'
        f'<ssd:System name="root">{system}</ssd:System>{root}</ssd:SystemStructureDescription>'
    )


@pytest.fixture
def make(block, tmp_path):
    """Return what writes an SSP of a system, and returns its scenario."""

    def made(system, root="", **files):
        kept = {"SystemStructure.ssd": ssd(system, root), "resources/Block.fmu": block}
        return ssp_scenario(fmus.zipped(tmp_path / "system.ssp", {**kept, **files}))

    return made


def component(name, more="", source="resources/Block.fmu"):
    return f'<ssd:Component name="{name}" source="{source}">{more}</ssd:Component>'


def elements(*parts):
    return f"<ssd:Elements>{''.join(parts)}</ssd:Elements>"


def connectors(**kinds):
    rows = (
        f'<ssd:Connector name="{name}" kind="{kind}"><ssc:Real unit="{unit}"/></ssd:Connector>'
        for name, (kind, _, unit) in ((n, k.partition(" ")) for n, k in kinds.items())
    )
    return f"<ssd:Connectors>{''.join(rows)}</ssd:Connectors>"


def connections(*rows):
    made = []
    for start, end, attributes, content in ((*row, "", "")[:4] for row in rows):
        words = ""
        for side, (element, _, name) in (
            ("start", start.rpartition(".")),
            ("end", end.rpartition(".")),
        ):
            words += f' {side}Element="{element}"' if element else ""
            words += f' {side}Connector="{name}"'
        made.append(f"<ssd:Connection{words} {attributes}>{content}</ssd:Connection>")
    return f"<ssd:Connections>{''.join(made)}</ssd:Connections>"


def parameter_set(units="", **values):
    rows = (f'<ssv:Parameter name="{n}"><ssv:{v}/></ssv:Parameter>' for n, v in values.items())
    return (
        f'<ssv:ParameterSet {NAMESPACES} version="1.0" name="p"><ssv:Parameters>{"".join(rows)}'
        f"</ssv:Parameters>{units}</ssv:ParameterSet>"
    )


def bindings(*sets, attributes=""):
    rows = (f"<ssd:ParameterBinding {attributes}>{one}</ssd:ParameterBinding>" for one in sets)
    return f"<ssd:ParameterBindings>{''.join(rows)}</ssd:ParameterBindings>"


def linear(factor, offset=0.0):
    return f'<ssc:LinearTransformation factor="{factor}" offset="{offset}"/>'


UNIT = '<ssd:Units><ssc:Unit name="ell"><ssc:BaseUnit m="1" factor="{}"/></ssc:Unit></ssd:Units>'
PAIR = elements(component("a"), component("b"))
INNER = (
    '<ssd:System name="inner">'
    + connectors(u="input", y="output", k="parameter")
    + elements(component("c"))
    + connections(("u", "c.u", "", linear(0.5, 0.1)), ("y", "c.y"), ("k", "c.k"))
    + "</ssd:System>"
)


def ran(data, folder, **more):
    """Return participant → values of its real outputs, at each step."""
    data = {**data, "step": "7812500ns", "duration": "390625us", **more}
    result = stepbus.run(stepbus.load(data, folder=folder), out=folder / "run")
    assert result.exit_code == 0, result.reason
    recording = stepbus.Recording(folder / "run")
    return {name: recording[f"{name}.out"].values[:, 0] for name in data["participants"]}


def test_values_are_to_the_bit_those_of_a_loop_over_fmpy(make, tmp_path, block):
    values = parameter_set(**{"a.k": 'Real value="3.5"', "inner.k": 'Real value="0.7"'})
    joined = connections(
        ("a.y", "b.u"), ("inner.u", "b.y", "", linear(-0.3, 0.2)), ("inner.y", "a.u")
    )
    data = make(elements(component("a"), component("b"), INNER) + joined + bindings(values))
    assert list(data["participants"]) == ["a", "b", "inner_c"]
    got = ran(data, tmp_path)
    wires = [
        ("a", "y", "b", "u", 1.0, 0.0),
        ("b", "y", "inner_c", "u", 0.5 * -0.3, 0.5 * 0.2 + 0.1),
        ("inner_c", "y", "a", "u", 1.0, 0.0),
    ]
    blocks = {"a": {"k": 3.5}, "b": {}, "inner_c": {"k": 0.7}}
    (tmp_path / "Block.fmu").write_bytes(block)
    asked = json.dumps([str(tmp_path / "Block.fmu"), blocks, wires, 50, 1 / 128])
    done = subprocess.run([sys.executable, "-c", LOOP, asked], check=True, capture_output=True)
    for step, row in enumerate(json.loads(done.stdout)):
        assert {name: float(got[name][step]).hex() for name in got} == row
    assert got["a"][49] != got["b"][49] != got["inner_c"][49]


def start(data, name):
    return data["participants"][name]["params"]["start"]


def inputs(data, name):
    return data["participants"][name]["params"]["inputs"]


def test_parameters_of_a_higher_level_and_later_ones_win(make):
    own = bindings(parameter_set(k='Real value="1"', s='String value="low"', none='Real value="1"'))
    outer = bindings(
        parameter_set(**{"a.k": 'Real value="2"', "b.k": 'Real value="3"', "no": 'Real value="1"'}),
        parameter_set(**{"a.k": 'Float64 value="4"'}),
    )
    data = make(elements(component("a", own), component("b")) + outer)
    assert start(data, "a") == {"k": 4.0, "s": "low"}
    assert start(data, "b") == {"k": 3.0}


def test_parameters_in_files_with_a_mapping_and_a_prefix(make):
    entry = '<ssm:MappingEntry source="{}" target="{}">{}</ssm:MappingEntry>'
    rows = ("p.length", "a.k", linear(2, 1)), ("p.f", "b.n_in", linear(2)), ("p.none", "b.k", "")
    mapping = "".join(entry.format(*row) for row in rows)
    named = '<ssd:ParameterMapping source="./resources/m%20n.ssm"/>'
    values = {"length": 'Real value="5" unit="ell"', "f": 'Real value="3"', "o": 'Real value="9"'}
    data = make(
        elements(component("a", connectors(k="parameter m")), component("b"))
        + bindings(named, attributes='source="resources/v.ssv" prefix="p."'),
        **{
            "resources/v.ssv": parameter_set(UNIT.format(0.5), **values),
            "resources/m n.ssm": f"<ssm:ParameterMapping {NAMESPACES}>{mapping}</ssm:ParameterMapping>",
        },
    )
    assert start(data, "a") == {"k": 2 * 2.5 + 1}
    assert start(data, "b") == {"n_in": 6}


def test_a_parameter_connector_of_a_system_reaches_what_it_is_connected_with(make):
    values = bindings(parameter_set(**{"inner.k": 'Real value="7"', "inner.u": 'Real value="2"'}))
    data = make(elements(INNER) + values)
    assert start(data, "inner_c") == {"k": 7.0, "u": 2.0 * 0.5 + 0.1}


def test_units_are_converted_at_each_connector_unless_that_is_suppressed(make):
    degrees = component("a", connectors(y="output deg"))
    radians = component("b", connectors(u="input rad"))
    keep = 'suppressUnitConversion="true"'
    third = component("c", connectors(u="input rad"))
    data = make(
        elements(degrees, radians, third)
        + connections(("a.y", "b.u", "", linear(2, 1)), ("a.y", "c.u", keep, linear(2)))
    )
    link = inputs(data, "b")["u"]
    assert link == {"from": "a.y", "convert": False, "factor": link["factor"], "offset": 1.0}
    assert link["factor"] == pytest.approx(2 * 3.141592653589793 / 180, rel=1e-15)
    assert inputs(data, "c")["u"] == {"from": "a.y", "convert": False, "factor": 2.0, "offset": 0.0}


def test_a_local_variable_is_published_where_it_is_connected(make, tmp_path):
    data = make(PAIR + connections(("a.x", "b.u")))
    assert data["participants"]["a"]["params"]["publish"] == ["x"]
    assert inputs(data, "b") == {"u": {"from": "a.x", "convert": False}}
    assert ran(data, tmp_path)["b"][-1] > 0


def test_an_input_that_is_not_connected_keeps_its_start_value(make, tmp_path):
    # The output `y` of both has the name of no input; `u` of b stays 0 as of a.
    values = ran(make(PAIR + connections(("a.n", "b.n_in"), ("a.b", "b.b_in"))), tmp_path)
    assert values["a"].tolist() == values["b"].tolist()
    recording = stepbus.Recording(tmp_path / "run")
    assert recording["b.out_integers"].values[1:, 0].tolist() == [2] * 50
    assert not recording["b.out_booleans"].values[2:, 0].any()


def test_a_scenario_in_another_folder_goes_on_from_a_system(make, tmp_path, block):
    make(PAIR + connections(("a.y", "b.u")))
    folder = tmp_path / "other"
    folder.mkdir()
    (tmp_path / "resources").mkdir()
    (tmp_path / "resources/Block.fmu").write_bytes(b"not this one")
    text = "extends: ../system.ssp\nstep: 10ms\nduration: 100ms\n"
    (folder / "scenario.yaml").write_text(text)
    loaded = stepbus.load(folder / "scenario.yaml", set={"a.params.start.k": 9})
    result = stepbus.run(loaded, out=folder / "run")
    assert result.exit_code == 0, result.reason


def test_times_are_those_of_the_system_and_annotations_are_ignored(make):
    note = '<ssd:Annotations><ssc:Annotation type="x"><y xmlns="z">1</y></ssc:Annotation></ssd:Annotations>'
    times = '<ssd:DefaultExperiment startTime="2" stopTime="2.5"/>'
    data = make(PAIR + note, root=note + times)
    assert list(data["participants"]) == ["a", "b"]
    assert data["participants"]["a"]["params"]["start_time"] == 2.0
    assert data["duration"] == "500ms"


BUS = '<ssd:SignalDictionaryReference name="bus" dictionary="d"/>'
CIRCLE = "".join(
    f'<ssd:System name="{name}">{connectors(u="input", y="output")}{connections(("u", "y"))}'
    "</ssd:System>"
    for name in "pq"
)


@pytest.mark.parametrize(
    ("system", "text"),
    [
        ("", "the system has no component"),
        (elements(component("a", source="resources/b.fmu")),
         "element a needs 'resources/b.fmu', which is not in the archive"),
        (elements(component("a", source="../b.fmu")), "which is not in the archive"),
        (elements(component("a", source="SystemStructure.ssd")),
         "element a: system.ssp/SystemStructure.ssd is no FMU"),
        (elements('<ssd:Component name="a"/>'), "element a: a Component has no 'source'"),
        (elements('<ssd:Component/>'), "the system: a Component has no 'name'"),
        (elements(component("a"), component("a")), "two elements with the name 'a'"),
        (elements(component("a.b"), component("a_b")), "a second participant with the name 'a_b'"),
        (elements(component("a"), BUS), "element bus is a SignalDictionaryReference"),
        (elements(component('a" implementation="ModelExchange')), "element a wants ModelExchange"),
        (PAIR + connections(("a.z", "b.u")), "connection a.z → b.u: element a has no 'z'"),
        (PAIR + connections(("d.y", "b.u")), "connection d.y → b.u: element d has no 'y'"),
        (PAIR + connections(("a.y", "b.u"), ("a.x", "b.u")),
         "connection a.x → b.u is a second source; there is connection a.y → b.u"),
        (PAIR + connections(("a.y", "b.y")), "connection a.y → b.y joins two sources"),
        (PAIR + connections(("a.u", "b.u")), "connection a.u → b.u joins two targets"),
        (PAIR + connections(("a.y", "b.n_in")), "a.y → b.n_in: Real is connected with Integer"),
        (PAIR + connections(("a.y", "a.u")), "a.y → a.u: an element is connected with itself"),
        (PAIR + connections(("a.y", "b.k")), "k is a parameter, and a.y is computed in the run"),
        (PAIR + connections(("a.y", "b.u", 'startIndices="1"', "")), "of some places of an array"),
        (PAIR + connections(("a.y", "b.u", "", linear("x"))), "a.y → b.u has the Real 'x'"),
        (elements(component("a", connectors(y="output kg")), component("b", connectors(u="input m")))
         + connections(("a.y", "b.u")), "a.y → b.u: unit 'kg' is no 'm'"),
        (elements(component("a"), CIRCLE) + connections(("p.y", "q.u"), ("q.y", "p.u"))
         + connections(("p.y", "a.u")), "connected in a circle"),
        (PAIR + bindings(parameter_set(**{"a.k": 'Real value="1,5"'})),
         "parameter a.k of the system has the Real '1,5'"),
        (PAIR + bindings(parameter_set(**{"a.k": 'Complex value="1"'})), "parameter a.k of the system has the Complex"),
        (PAIR + bindings(parameter_set(**{"a.k": "Real"})), "parameter a.k of the system has no value"),
        (PAIR + bindings(""), "a parameter binding of the system has no ParameterSet"),
        (PAIR + bindings("", attributes='source="x.ssv"'), "binding of the system needs 'x.ssv'"),
        (PAIR + bindings("", attributes='sourceBase="component"'), "of the system is in its component"),
        (elements(component("a", source="inner.ssp")), "element a is an SSP itself"),
        (elements(component('a" type="application/x-ssp-definition')), "element a is an SSP itself"),
        *((PAIR + connections(("a.n", "b.n_in", "", f"<ssc:{kind}MappingTransformation/>")),
           f"connection a.n → b.n_in has a {kind}MappingTransformation, which is not supported")
          for kind in ("Boolean", "Integer", "Enumeration")),
        (None, "no SSP: BadZipFile: File is not a zip file"),
        ({"x": ""}, "an SSP needs 'SystemStructure.ssd', which is not in the archive"),
        ({"SystemStructure.ssd": "<a"}, "SystemStructure.ssd cannot be read: XMLSyntaxError"),
        ({"SystemStructure.ssd": "<a/>"}, "is a a, not a SystemStructureDescription"),
        ({"SystemStructure.ssd": '<!DOCTYPE a [<!ENTITY e SYSTEM "/etc/passwd">]><a>&e;</a>'},
         "has a DOCTYPE, which SSP does not allow"),
        ({"SystemStructure.ssd": ssd("", UNIT.format("x"))}, "unit ell has the Real 'x'"),
    ],
)  # fmt: skip
def test_what_cannot_run_is_refused_by_name(tmp_path, block, system, text):
    path = tmp_path / "system.ssp"
    files = (
        {"SystemStructure.ssd": ssd(system), "resources/Block.fmu": block}
        if isinstance(system, str)
        else system
    )
    path.write_text("no zip") if files is None else fmus.zipped(path, files)
    with pytest.raises(WiringError) as caught:
        ssp_scenario(path)
    assert text in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    with pytest.raises(stepbus.ScenarioError) as caught:
        stepbus.load(path)
    assert "system.ssp: " in str(caught.value)
    assert text in str(caught.value)

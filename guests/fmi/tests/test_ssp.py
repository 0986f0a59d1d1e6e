"""Systems of FMUs (SSP) run as a hand-written loop over FMPy's calls does."""

import json
import re
import subprocess
import sys
from functools import partial

import fmus
import pytest
from stepbus_fmi.files import ssp_scenario

import stepbus
from stepbus_schemas import WiringError

BLOCK = """
class Block(Fmi2Slave):
    def __init__(self, **options):
        super().__init__(**options)
        self.x, self.u, self.k, self.y = 0.0, 0.0, 2.0, 1.0
        self.n_in, self.n, self.b_in, self.b, self.s = 0, 1, False, True, "as it was"
        read, shown = {"causality": Fmi2Causality.input}, {"causality": Fmi2Causality.output}
        fixed = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.fixed}
        rare = {"variability": Fmi2Variability.discrete}
        for variable in (
            Real("u", **read), Real("y", **shown), Real("x"), Real("k", **fixed), String("s", **fixed),
            Integer("n_in", **read, **rare), Integer("n", **shown, **rare),
            Boolean("b_in", **read, **rare), Boolean("b", **shown, **rare),
        ):
            self.register_variable(variable)

    def do_step(self, time, h):
        self.x += h * (self.k * self.u - self.x) + 0.01
        self.y = self.x + 1.0
        self.n, self.b = (self.n_in + 1) % 5, not self.b_in
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
    fmu.setReal([refs["k"]], [start])
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
for step in range(steps):
    print(json.dumps({n: f.getReal([refs["y"]])[0].hex() for n, f in made.items()}))
    got = [made[source].getReal([refs["y"]])[0] for source, *_ in wires]
    for value, (_, target, factor, offset) in zip(got, wires):
        made[target].setReal([refs["u"]], [value * factor + offset])
    for fmu in made.values():
        fmu.doStep(step * h, h)
"""
NAMES = {"ssd": "Description", "ssc": "Common", "ssv": "ParameterValues", "ssm": "ParameterMapping"}
BASE = "http://ssp-standard.org/SSP1/SystemStructure"
NAMESPACES = {f"xmlns:{short}": BASE + name for short, name in NAMES.items()}
SSD = "SystemStructure.ssd"


def xml(name, /, *content, **attributes):
    words = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f"<{name}{words}>{''.join(content)}</{name}>"


def ssd(system, *more):
    root = xml("ssd:System", system, name="root")
    return xml("ssd:SystemStructureDescription", root, *more, **NAMESPACES, name="made")


def component(name, *more, source="resources/Block.fmu", **attributes):
    return xml("ssd:Component", *more, name=name, source=source, **attributes)


def connectors(**kinds):
    rows = ((name, *text.partition(" ")[::2]) for name, text in kinds.items())
    made = (xml("ssd:Connector", xml("ssc:Real", unit=u), name=n, kind=k) for n, k, u in rows)
    return xml("ssd:Connectors", *made)


def connections(*rows):
    made = []
    for start, end, *more in rows:
        words, *content = more or [{}]
        for side, text in (("start", start), ("end", end)):
            element, _, name = text.rpartition(".")
            words = {f"{side}Connector": name, **words}
            words |= {f"{side}Element": element} if element else {}
        made.append(xml("ssd:Connection", *content, **words))
    return xml("ssd:Connections", *made)


def parameter_set(*more, **values):
    rows = (xml("ssv:Parameter", f"<ssv:{v}/>", name=n) for n, v in values.items())
    return xml("ssv:ParameterSet", xml("ssv:Parameters", *rows), *more, **NAMESPACES, name="p")


def bindings(*sets, **attributes):
    rows = (xml("ssd:ParameterBinding", one, **attributes) for one in sets)
    return xml("ssd:ParameterBindings", *rows)


def linear(factor, offset=0.0):
    return xml("ssc:LinearTransformation", factor=factor, offset=offset)


ELL = '<ssd:Units><ssc:Unit name="ell"><ssc:BaseUnit m="1" factor="{}"/></ssc:Unit></ssd:Units>'
elements = partial(xml, "ssd:Elements")
PAIR = elements(component("a"), component("b"))
LINKS = connections(("u", "c.u", {}, linear(0.5, 0.1)), ("y", "c.y"), ("k", "c.k"))
INSIDE = connectors(u="input", y="output", k="parameter"), elements(component("c")), LINKS
INNER = xml("ssd:System", *INSIDE, name="inner")


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    """Return the bytes of an FMU."""
    return fmus.build(tmp_path_factory.mktemp("block"), BLOCK).read_bytes()


@pytest.fixture
def make(block, tmp_path):
    """Return what writes an SSP of a system, and returns its scenario."""

    def made(*system, more=(), **files):
        kept = {SSD: ssd("".join(system), *more), "resources/Block.fmu": block}
        return ssp_scenario(fmus.zipped(tmp_path / "system.ssp", kept | files))

    return made


def ran(data, folder):
    """Return participant → values of its real outputs, at each step."""
    data = {**data, "step": "7812500ns", "duration": "390625us"}
    result = stepbus.run(stepbus.load(data, folder=folder), out=folder / "run")
    assert result.exit_code == 0, result.reason
    recording = stepbus.Recording(folder / "run")
    return {name: recording[f"{name}.out"].values[:, 0] for name in data["participants"]}


def test_values_are_to_the_bit_those_of_a_loop_over_fmpy(make, tmp_path, block):
    values = parameter_set(**{"a.k": 'Real value="3.5"', "inner.k": 'Real value="0.7"'})
    turned = ("inner.u", "b.y", {}, linear(-0.3, 0.2))
    joined = connections(("a.y", "b.u"), turned, ("inner.y", "a.u"))
    data = make(elements(component("a"), component("b"), INNER), joined, bindings(values))
    assert list(data["participants"]) == ["a", "b", "inner_c"]
    got = ran(data, tmp_path)
    back = 0.5 * -0.3, 0.5 * 0.2 + 0.1
    wires = ("a", "b", 1.0, 0.0), ("b", "inner_c", *back), ("inner_c", "a", 1.0, 0.0)
    blocks = {"a": 3.5, "b": 2.0, "inner_c": 0.7}
    (tmp_path / "Block.fmu").write_bytes(block)
    asked = json.dumps([str(tmp_path / "Block.fmu"), blocks, wires, 50, 1 / 128])
    done = subprocess.run([sys.executable, "-c", LOOP, asked], check=True, capture_output=True)
    for step, row in enumerate(map(json.loads, done.stdout.splitlines())):
        assert {name: float(got[name][step]).hex() for name in got} == row
    assert step == 49
    assert got["a"][49] != got["b"][49] != got["inner_c"][49]


def params(data, name):
    return data["participants"][name]["params"]


def test_parameters_of_a_higher_level_and_later_ones_win_and_pass_connectors(make):
    own = bindings(parameter_set(k='Real value="1"', s='String value="low"', none='Real value="1"'))
    outer = bindings(
        parameter_set(**{"a.k": 'Real value="2"', "b.k": 'Real value="3"', "no": 'Real value="1"'}),
        parameter_set(**{"a.k": 'Float64 value="4"', "inner.u": 'Real value="2"'}),
    )
    data = make(elements(component("a", own), component("b"), INNER), outer)
    assert params(data, "a")["start"] == {"k": 4.0, "s": "low"}
    assert params(data, "b")["start"] == {"k": 3.0}
    assert params(data, "inner_c")["start"] == {"u": 2.0 * 0.5 + 0.1}


def test_parameters_in_files_with_a_mapping_and_a_prefix(make):
    rows = ("p.length", "a.k", linear(2, 1)), ("p.f", "b.n_in", linear(2)), ("p.none", "b.k", "")
    entries = (xml("ssm:MappingEntry", by, source=s, target=t) for s, t, by in rows)
    values = {"length": 'Real value="5" unit="ell"', "f": 'Real value="3"', "o": 'Real value="9"'}
    files = {
        "resources/v.ssv": parameter_set(ELL.format(0.5), **values),
        "resources/m n.ssm": xml("ssm:ParameterMapping", *entries, **NAMESPACES),
    }
    mapping = xml("ssd:ParameterMapping", source="./resources/m%20n.ssm")
    metres = component("a", connectors(k="parameter m"))
    binding = bindings(mapping, source="resources/v.ssv", prefix="p.")
    data = make(elements(metres, component("b")), binding, **files)
    assert params(data, "a")["start"] == {"k": 2 * 2.5 + 1}
    assert params(data, "b")["start"] == {"n_in": 6}


def test_units_are_converted_at_each_connector_unless_that_is_suppressed(make):
    degrees = component("a", connectors(y="output deg"))
    radians = (component(name, connectors(u="input rad")) for name in "bc")
    keep = ("a.y", "c.u", {"suppressUnitConversion": "true"}, linear(2))
    joined = connections(("a.y", "b.u", {}, linear(2, 1)), keep)
    data = make(elements(degrees, *radians), joined)
    link = params(data, "b")["inputs"]["u"]
    assert link == {"from": "a.y", "convert": False, "factor": link["factor"], "offset": 1.0}
    assert link["factor"] == pytest.approx(2 * 3.141592653589793 / 180, rel=1e-15)
    kept = {"from": "a.y", "convert": False, "factor": 2.0, "offset": 0.0}
    assert params(data, "c")["inputs"]["u"] == kept


def test_integers_booleans_and_local_variables_are_connected_and_nothing_else(make, tmp_path):
    joined = connections(("a.x", "c.u"), ("a.n", "b.n_in"), ("a.b", "b.b_in"))
    data = make(elements(*map(component, "abc")), joined)
    assert params(data, "a")["publish"] == ["x"]
    assert params(data, "c")["inputs"] == {"u": {"from": "a.x", "convert": False}}
    values = ran(data, tmp_path)
    # Nothing is connected by its name: `u` of b keeps its start value, as that of a.
    assert values["a"].tolist() == values["b"].tolist() != values["c"].tolist()
    recording = stepbus.Recording(tmp_path / "run")
    assert recording["b.out_integers"].values[1:, 0].tolist() == [2] * 50
    assert not recording["b.out_booleans"].values[2:, 0].any()


def test_a_scenario_in_another_folder_goes_on_from_a_system(make, tmp_path, block):
    make(PAIR + connections(("a.y", "b.u")))
    folder = tmp_path / "other"
    folder.mkdir()
    (tmp_path / "resources").mkdir()
    (tmp_path / "resources/Block.fmu").write_bytes(b"not this one")
    (folder / "scenario.yaml").write_text("extends: ../system.ssp\nduration: 100ms\n")
    loaded = stepbus.load(folder / "scenario.yaml", set={"a.params.start.k": 9})
    result = stepbus.run(loaded, out=folder / "run")
    assert result.exit_code == 0, result.reason


def test_times_are_those_of_the_system_and_annotations_are_ignored(make):
    note = xml("ssd:Annotations", xml("ssc:Annotation", '<y xmlns="z">1</y>', type="x"))
    times = xml("ssd:DefaultExperiment", startTime=2, stopTime=2.5)
    data = make(PAIR, note, more=(note, times))
    assert list(data["participants"]) == ["a", "b"]
    assert params(data, "a")["start_time"] == 2.0
    assert data["duration"] == "500ms"


LOOPED = connectors(u="input", y="output"), connections(("u", "y"))
SYSTEMS = (xml("ssd:System", *LOOPED, name=name) for name in "pq")
CIRCLE = connections(("p.y", "q.u"), ("q.y", "p.u"), ("p.y", "a.u"))
KG = elements(component("a", connectors(y="output kg")), component("b", connectors(u="input m")))


@pytest.mark.parametrize(
    ("system", "text"),
    [
        ("", "the system has no component"),
        (component("a", source="../b.fmu"), "element a needs '../b.fmu', which is not in the archive"),
        (component("a", source=SSD), f"element a: system.ssp/{SSD} is no FMU"),
        ('<ssd:Component name="a"/>', "element a: a Component has no 'source'"),
        ("<ssd:Component/>", "the system: a Component has no 'name'"),
        (component("a") * 2, "two elements with the name 'a'"),
        (component("a.b") + component("a_b"), "a second participant with the name 'a_b'"),
        (xml("ssd:SignalDictionaryReference", name="bus"), "element bus is a SignalDictionaryReference"),
        (component("a", implementation="ModelExchange"), "element a wants ModelExchange"),
        (component("a", source="i.ssp", type="x-ssp"), "element a is an SSP itself"),
        (("a.z", "b.u"), "connection a.z → b.u: element a has no 'z'"),
        (PAIR + connections(("a.y", "b.u"), ("a.x", "b.u")), "a.x → b.u is a second source; there is"),
        (("a.y", "b.y"), "connection a.y → b.y joins two sources"),
        (("a.y", "b.n_in"), "a.y → b.n_in: Real is connected with Integer"),
        (("a.y", "a.u"), "a.y → a.u: an element is connected with itself"),
        (("a.y", "b.k"), "k is a parameter, and a.y is computed in the run"),
        (("a.y", "b.u", {"startIndices": 1}), "of some places of an array"),
        (("a.y", "b.u", {}, linear("x")), "a.y → b.u has the Real 'x'"),
        (("a.n", "b.n_in", {}, xml("ssc:BooleanMappingTransformation")), "has a BooleanMappingTransf"),
        (KG + connections(("a.y", "b.u")), "a.y → b.u: unit 'kg' is no 'm'"),
        (elements(component("a"), *SYSTEMS) + CIRCLE, "connected in a circle"),
        (PAIR + bindings(parameter_set(**{"a.k": 'Real value="1,5"'})), "a.k of the system has the Real"),
        (PAIR + bindings(parameter_set(**{"a.k": "Real"})), "parameter a.k of the system has no value"),
        (PAIR + bindings(""), "a parameter binding of the system has no ParameterSet"),
        (PAIR + bindings("", source="x.ssv"), "binding of the system needs 'x.ssv'"),
        (PAIR + bindings("", sourceBase="component"), "system is in its component"),
        (None, "no SSP: BadZipFile: File is not a zip file"),
        ({"x": ""}, f"an SSP needs '{SSD}', which is not in the archive"),
        ({SSD: "<a"}, f"{SSD} cannot be read: XMLSyntaxError"),
        ({SSD: "<a/>"}, "is a a, not a SystemStructureDescription"),
        ({SSD: '<!DOCTYPE a [<!ENTITY e SYSTEM "/etc/passwd">]><a>&e;</a>'}, "has a DOCTYPE, which"),
        ({SSD: ssd("", ELL.format("x"))}, "unit ell has the Real 'x'"),
    ],
)  # fmt: skip
def test_what_cannot_run_is_refused_by_name(tmp_path, block, system, text):
    path = tmp_path / "system.ssp"
    system = PAIR + connections(system) if isinstance(system, tuple) else system
    if isinstance(system, str):
        whole = system if "Elements" in system else elements(system)
        system = {SSD: ssd(whole), "resources/Block.fmu": block}
    path.write_text("no zip") if system is None else fmus.zipped(path, system)
    with pytest.raises(WiringError) as caught:
        ssp_scenario(path)
    assert text in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1
    with pytest.raises(stepbus.ScenarioError, match=f"system.ssp: .*{re.escape(text)}"):
        stepbus.load(path)

"""FMUs for the tests: of a Python class by pythonfmu, and of a small C file by the compiler."""

import re
import shutil
import subprocess
import tempfile
import zipfile
from functools import cache
from pathlib import Path

import fmpy
import pytest
from fmpy import fmi2, fmi3

_HEADERS = Path(fmpy.__file__).with_name("c-code")
_EVERY = {
    2: [name for name in dir(fmi2.FMU2Slave) if name.startswith("fmi2")],
    3: [name for name in dir(fmi3.FMU3Slave) if name.startswith("fmi3")],
}


def build(folder, source_text):
    """Return the FMU (FMI 2.0) of a class derived from `Fmi2Slave`, made by pythonfmu."""
    from pythonfmu.builder import FmuBuilder  # noqa: PLC0415  (it takes long)

    name = re.search(r"class (\w+)\(Fmi2Slave\)", source_text)[1]
    script = folder / f"{name}.py"
    script.write_text(f"from pythonfmu import *\n{source_text}")
    FmuBuilder.build_FMU(script, dest=folder, needsExecutionTool=False)
    return folder / f"{name}.fmu"


def compiler():
    """Return the C compiler; skips the test where there is none."""
    return shutil.which("cc") or pytest.skip("no C compiler (cc) is installed")


@cache
def _library(source, name, major, missing):
    """Return the compiled bytes of a C file; functions that it lacks return an error."""
    compiler = shutil.which("cc") or pytest.skip("no C compiler (cc) is installed")
    rest = (one for one in _EVERY[major] if one not in missing)
    with tempfile.TemporaryDirectory() as folder:
        # Of two definitions, the linker takes that which is not weak.
        weak = "".join(f"__attribute__((weak)) int {one}() {{ return 3; }}\n" for one in rest)
        Path(folder, "rest.c").write_text(weak)
        Path(folder, "own.c").write_text(source)
        words = ["-shared", "-fPIC", "-w", f"-I{_HEADERS}", "-o", name, "own.c", "rest.c", "-lm"]
        subprocess.run([compiler, *words], cwd=folder, check=True)
        return Path(folder, name).read_bytes()


def build_c(folder, source, xml, missing=(), more=None):
    """Return the FMU of a C file and a model description, named as its `modelIdentifier`.

    missing: functions that it has not; all others of the standard that the file lacks return an
    error. more: further files, name → content.
    """
    name = re.search(r'modelIdentifier="(\w+)"', xml)[1]
    major = int(re.search(r'fmiVersion="(\d)', xml)[1])
    place = fmpy.platform if major == 2 else fmpy.platform_tuple
    library = _library(source, f"{name}.so", major, tuple(missing))
    files = {"modelDescription.xml": xml, f"binaries/{place}/{name}.so": library}
    return zipped(folder / f"{name}.fmu", {**files, **(more or {})})


def zipped(path, files):
    """Write an archive of name → text or bytes; return its path."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return path


def xml2(variables, can="", name="model", more="", units="", types=""):
    """Return a model description for FMI 2.0; variables: XML of each. can: flags, as attributes."""
    rows = "".join(f"<ScalarVariable {v}</ScalarVariable>" for v in variables)
    outputs = "".join(
        f'<Unknown index="{n}"/>' for n, v in enumerate(variables, 1) if '"output"' in v
    )
    return (
        f'<?xml version="1.0"?><fmiModelDescription fmiVersion="2.0" modelName="{name}" '
        f'guid="g" {more}><CoSimulation modelIdentifier="{name}" {can}/>'
        f"{units}{types}<ModelVariables>{rows}</ModelVariables>"
        f"<ModelStructure><Outputs>{outputs}</Outputs></ModelStructure></fmiModelDescription>"
    )


def xml3(variables, can="", name="model", more="", units="", types=""):
    """Return a model description for FMI 3.0; variables: XML of each. can: flags, as attributes."""
    return (
        f'<?xml version="1.0"?><fmiModelDescription fmiVersion="3.0" modelName="{name}" '
        f'instantiationToken="g" {more}><CoSimulation modelIdentifier="{name}" {can}/>'
        f"{units}{types}<ModelVariables>{''.join(variables)}</ModelVariables><ModelStructure/>"
        "</fmiModelDescription>"
    )

"""A recording is complete: each language's program runs again from it, its folder gone.

The programs count steps in format raw; the sum is in a file that their language loads by itself.
"""

import shutil
import subprocess
import sys

import pytest
from support.tools import needs

from stepbus_orchestrator.cli import main
from stepbus_orchestrator.run.run_scenario import Options, run
from stepbus_orchestrator.scenario.load import load

SCENARIO = """\
name: counter
step: 5ms
duration: 50ms
participants:
  counter:
    exec: {command}
    bridge: {{format: raw, describe: {{count: {{names: [n]}}}}}}
    outputs: {{count: Scalars/1}}
"""
PYTHON = """\
import struct, sys
from law import law

come, go = open(3, "rb", buffering=0), open(4, "wb", buffering=0)
go.write(struct.pack("<d", 1))
come.read(64)
while step := come.read(16):
    go.write(struct.pack("<d", law(struct.unpack("<2d", step)[0])))
"""
PERL = """\
use lib '.';
use Own::Law;
open(my $in, '<&=', 3); open(my $out, '>&=', 4);
syswrite($out, pack('d<', 1));
sysread($in, my $header, 64);
while (sysread($in, my $step, 16)) { syswrite($out, pack('d<', Own::Law::law(unpack('d<', $step)))); }
"""
OCTAVE = """\
come = fopen('/dev/fd/3', 'r', 'ieee-le');
go = fopen('/dev/fd/4', 'w', 'ieee-le');
fwrite(go, 1, 'double'); fflush(go);
header = fread(come, 8, 'double');
while true
  step = fread(come, 2, 'double');
  if numel(step) < 2, break, end
  fwrite(go, law(step(1)), 'double'); fflush(go);
end
"""
JAVA = """\
package own;
import java.io.*;
import java.nio.*;
public class Counter {
    public static void main(String[] words) throws IOException {
        DataInputStream in = new DataInputStream(new FileInputStream("/dev/fd/3"));
        FileOutputStream out = new FileOutputStream("/dev/fd/4");
        out.write(number(1).array());
        in.readFully(new byte[64]);
        byte[] step = new byte[16];
        while (in.readNBytes(step, 0, 16) == 16)
            out.write(number(Law.law(ByteBuffer.wrap(step).order(ByteOrder.LITTLE_ENDIAN).getDouble())).array());
    }
    static ByteBuffer number(double value) {
        return ByteBuffer.allocate(8).order(ByteOrder.LITTLE_ENDIAN).putDouble(value);
    }
}
"""
LAW = {
    "law.py": "def law(step):\n    return 3 * step\n",
    "Own/Law.pm": "package Own::Law;\nsub law { return 3 * $_[0]; }\n1;\n",
    "law.m": "function y = law(step)\n  y = 3 * step;\nend\n",
    "own/Law.java": "package own;\nclass Law { static double law(double s) { return 3 * s; } }\n",
}


def written(folder, command, **texts):
    """Write a scenario and its programs; return the scenario's folder."""
    folder.mkdir()
    files = {"scenario.yaml": SCENARIO.format(command=command), **texts}
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    return folder


def laws(*names):
    return {name: LAW[name] for name in names}


def perl(folder):
    needs("perl")
    return written(folder, "[perl, counter.pl]", **{"counter.pl": PERL, **laws("Own/Law.pm")})


def octave(folder):
    needs("octave-cli")
    command = "[octave-cli, --quiet, --no-init-file, counter.m]"
    return written(folder, command, **{"counter.m": OCTAVE, **laws("law.m")})


def java(folder):
    needs("java", "javac")
    sources = {"own/Counter.java": JAVA, **laws("own/Law.java")}
    written(folder, "[java, -cp, build, own.Counter]", **sources)
    words = ["javac", "-d", "build", *sources]
    subprocess.run(words, cwd=folder, check=True)
    shutil.rmtree(folder / "own")
    scenario = folder / "scenario.yaml"
    # Folders of what is built are left out, unless they are declared.
    scenario.write_text(scenario.read_text().replace("exec:", "files: [build/]\n    exec:"))
    return folder


def virtual(folder):
    """An environment of its own outside of the folder, with a module that only it has."""
    home = folder.with_name("environment")
    words = [sys.executable, "-m", "venv", "--without-pip", str(home)]
    subprocess.run(words, check=True)
    (site,) = home.glob("lib/python*/site-packages")
    (site / "law.py").write_text(LAW["law.py"])
    return written(folder, f"['{home}/bin/python', counter.py]", **{"counter.py": PYTHON})


def recorded(folder):
    """Run a scenario, then remove its folder; return the result."""
    result = run(load(folder), Options(out=folder.with_name("out")))
    assert (result.exit_code, result.steps) == (0, 10), result.reason
    shutil.rmtree(folder)
    return result


@pytest.mark.parametrize("make", [perl, octave, java, virtual])
def test_a_program_runs_again_from_its_recording_when_its_folder_is_gone(make, tmp_path, capsys):
    result = recorded(make(tmp_path / "own"))
    assert not result.warnings
    moved = shutil.move(result.recording, tmp_path / "moved.mcap")
    assert main(["rerun", str(moved), "--trust", "--out", str(tmp_path / "again")]) == 0
    assert "byte for byte as recorded" in capsys.readouterr().out

"""What a notebook shows, and the example notebook of the docs."""

import nbformat
import pytest
from nbclient import NotebookClient
from support.messages.recordings import write
from support.paths import CHECKOUT

from stepbus_orchestrator.recording import Recording
from stepbus_orchestrator.run.result import Result
from stepbus_schemas import Event, JointState, WiringError
from stepbus_tools.viewing.notebook import recording_html, result_html

EXAMPLE = CHECKOUT / "docs/guide/looking/notebook.ipynb"


@pytest.fixture
def recording(tmp_path):
    states = [JointState(position=[0.1 * step, 0.0]) for step in range(50)]
    events = [Event(level="info", text="started")]
    path = write(
        tmp_path / "a<b.mcap",
        joint_state=("JointState/1", ["hip", "knee"], states),
        events=("Event/1", [], events),
    )
    with Recording(path) as opened:
        yield opened


def test_a_recording_shows_its_ports(recording):
    html = recording_html(recording)
    assert "<td>plant/joint_state</td><td>JointState/1</td><td>hip, knee</td>" in html
    assert "a&lt;b.mcap" in html
    assert repr(recording).endswith("a<b.mcap, up to step 49>")


def test_a_recording_plots_its_joints_unless_told(recording, tmp_path):
    plot = recording.plot()
    assert plot.png.startswith(b"\x89PNG")
    assert plot.save(tmp_path / "plot.png").stat().st_size == len(plot.png)
    assert recording.plot("plant.joint_state.position[knee]").png != plot.png
    with pytest.raises(WiringError, match="has no port"):
        recording.plot("plant.none")


def test_a_result_shows_its_outcome_and_who_failed(tmp_path):
    result = Result(
        scenario="arm", outcome="failed", exit_code=4, reason="silent & gone",
        participant="controller", at_step=7, steps=7, step_ns=10_000_000, seed=0, window=8,
        transport="unix", start_s=0.1, wall_s=1.0, real_time_factor=1.2, sha256="ab", folder="x",
    )  # fmt: skip
    html = result_html(result)
    assert "failed</span> silent &amp; gone" in html
    assert "<td>controller, step 7</td>" in html


def shown(notebook):
    """Return the forms in which the cells of a notebook show what they return."""
    return [
        {form for output in cell.get("outputs", ()) for form in output.get("data", ())}
        for cell in notebook.cells
        if cell.cell_type == "code"
    ]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_the_example_notebook_shows_what_it_shows_in_the_docs(tmp_path):
    notebook = nbformat.read(EXAMPLE, as_version=4)
    before = shown(notebook)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs = []
    resources = {"metadata": {"path": str(tmp_path)}}
    NotebookClient(notebook, timeout=110, kernel_name="python3", resources=resources).execute()
    assert shown(notebook) == before
    assert before[0] >= {"text/html"}
    assert before[1] >= {"text/html"}
    assert before[2] >= {"image/png"}

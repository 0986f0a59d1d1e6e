"""A scenario whose messages fill the buffers of a link."""

_TALKER = """
import os, signal
from stepbus import Event, JointReference, Participant

class Mission(Participant):
    def update(self, step):
        row = [float(step.index)] * 2000
        return {"reference": JointReference(position=row, velocity=row, acceleration=row)}

class Reader(Participant):
    def start(self, inputs):
        if self.config.params.get("frozen"):
            os.kill(os.getpid(), signal.SIGSTOP)

    def update(self, step):
        return {"event": Event(level="info", text=str(step.index))}
"""

_LARGE = """
name: large
step: 5ms
duration: 500ms
participants:
  mission: {participant: talk.py:Mission, outputs: {reference: JointReference/1}}
  reader:
    participant: talk.py:Reader
    inputs: {reference: mission.reference}
    outputs: {event: Event/1}
    step_timeout: 30s
"""


def write_large(folder):
    """Write the scenario and its program into a folder; return the folder."""
    (folder / "talk.py").write_text(_TALKER)
    (folder / "scenario.yaml").write_text(_LARGE)
    return folder

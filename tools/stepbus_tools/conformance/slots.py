"""Bulk content in files that the participant under test shares with its peers (P17)."""

import os
from collections.abc import Mapping
from pathlib import Path

from msgspec import structs

from stepbus_orchestrator.processes.slots import slot_counts
from stepbus_orchestrator.scenario.model import ParticipantSpec, Scenario
from stepbus_participant import SlotError, SlotWriter, file_name, make_file, read_slot
from stepbus_schemas import Outputs, Ready


class SharedSlots:
    """A file for each bulk output of one participant and of those that it reads.

    agreed: output → number of its slots, once the participant has named those that it can use.
    """

    def __init__(self, folder: Path, scenario: Scenario, spec: ParticipantSpec) -> None:
        self.folder = folder
        self.agreed: dict[str, int] = {}
        self._name = spec.name
        own = {file_name(spec.name, port) for port in spec.outputs}
        read = {file_name(item.source, item.port) for item in spec.inputs.values()}
        # It publishes what its peers have recorded, and waits for no answer.
        counts = slot_counts(scenario, has_feedback=False)
        self._counts = {n: c for n, c in counts.items() if n in own | read}
        folder.mkdir(0o700)
        self._files = {name: make_file(folder / name, 0o600) for name in self._counts}
        self._writers: dict[str, SlotWriter] = {}

    def agree(self, ready: Ready) -> Mapping[str, int]:
        """Return output → number of its slots, for the `Start`."""
        self.agreed = {n: count for n, count in self._counts.items() if n in ready.slots}
        for name, count in self.agreed.items():
            self._writers[name] = SlotWriter(self._files[name], count, self.folder / name)
        return self.agreed

    def write(
        self, source: str, outputs: Outputs, content: dict[str, bytes], late: int = 0
    ) -> tuple[Outputs, dict[str, bytes]]:
        """Write content of a peer into slots; return its outputs, and the content for messages.

        late: by how many steps the stamps are wrong.
        """
        names = {port: file_name(source, port) for port in content}
        slots = {
            port: self._writers[name].write(outputs.step - late, content[port])
            for port, name in names.items()
            if name in self.agreed
        }
        rest = {port: data for port, data in content.items() if port not in slots}
        return structs.replace(outputs, slots=slots), rest

    def read(self, port: str, outputs: Outputs) -> bytes:
        """Return the content that the participant has written; raises SlotError."""
        name, length = file_name(self._name, port), outputs.bulk.get(port)
        if name not in self.agreed or length is None:
            raise SlotError("it is in a slot, but no slots were agreed on")
        return read_slot(self._files[name], outputs.slots[port], outputs.step, length)

    def close(self) -> None:
        """Close the files; harmless when repeated."""
        while self._files:
            os.close(self._files.popitem()[1])

"""A scenario written in Python, without a file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from stepbus_orchestrator import Scenario as CheckedScenario
from stepbus_orchestrator import check_data
from stepbus_participant import PortType

from .overrides import Overrides, overrides, plain


@dataclass(kw_only=True)
class Scenario:
    """A scenario that you write in Python; give it to `stepbus.run`.

    ```python
    scenario = stepbus.Scenario(name="swing", step="5ms", duration="2s")
    scenario.add(
        "plant", "stepbus_plant:Plant", publishes="first",
        inputs={"command": "controller.command"}, outputs={"joint_state": stepbus.JointState},
        params={"world": "world.yaml"},
    )
    ```

    step, duration: with a unit; without a duration, it runs until a participant ends it. folder:
    what relative file names are relative to. options: the other keys of a scenario file, such as
    `window` or `bus`. participants: name → keys of the scenario file; see `add`.
    """

    name: str
    step: str
    duration: str | None = None
    seed: int = 0
    folder: Path = field(default_factory=Path.cwd)
    options: Mapping[str, Any] = field(default_factory=dict)
    participants: dict[str, dict[str, Any]] = field(default_factory=dict)

    def add(
        self,
        name: str,
        program: str | Sequence[str],
        *,
        inputs: Mapping[str, str | Mapping[str, Any]] | None = None,
        outputs: Mapping[str, PortType | Mapping[str, Any]] | None = None,
        params: Mapping[str, Any] | None = None,
        **options: Any,
    ) -> Self:
        """Add a participant and return the scenario.

        program: its class, as `participant` of a scenario file has it, or its command line, as
        `exec`. inputs: port → `participant.output`, or a map with `from` and
        `delay`. outputs: port → message class, its name, or a map with `type` and `bulk`. params:
        what the participant reads. options: the other keys of a participant, such as `every`,
        `publishes` or `step_timeout`.
        """
        given = {"inputs": inputs, "outputs": outputs, "params": params, **options}
        rows = {key: value for key, value in given.items() if value is not None}
        start = {"participant": program} if isinstance(program, str) else {"exec": list(program)}
        self.participants[name] = {**start, **rows}
        return self

    def data(self) -> dict[str, Any]:
        """Return it as plain data, as a scenario file has it."""
        content: dict[str, Any] = plain(
            {
                "name": self.name,
                "step": self.step,
                "duration": self.duration,
                "seed": self.seed,
                **self.options,
                "participants": self.participants,
            }
        )
        return {key: value for key, value in content.items() if value is not None}

    def check(
        self,
        *,
        set: Overrides = (),  # noqa: A002  as --set on the command line
        faults: Sequence[str] = (),
    ) -> CheckedScenario:
        """Return it checked; start nothing. set, faults: as of `stepbus.load`.

        Raises ScenarioError with every problem and its path.
        """
        return check_data(self.data(), Path(self.folder), overrides(set), faults)

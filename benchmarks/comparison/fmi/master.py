# mypy: ignore-errors
"""libcosim as the master of the two FMUs, with its fixed-step algorithm and its CSV observer."""

import sys

import arm
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

LINKS = {"plant": ("q1", "q2", "v1", "v2"), "controller": ("torque1", "torque2")}


def main(fmus: str, logs: str) -> None:
    """Connect what has the same name, and run."""
    execution = CosimExecution.from_step_size(round(arm.STEP_S * 1e9))
    slaves = {}
    for name in LINKS:
        slave = CosimLocalSlave(f"{fmus}/{name.capitalize()}.fmu", name)
        slaves[name] = execution.add_local_slave(slave)
    variables = {
        name: {v.name.decode(): v.reference for v in execution.slave_variables(index)}
        for name, index in slaves.items()
    }
    for source, target in (("plant", "controller"), ("controller", "plant")):
        for link in LINKS[source]:
            execution.connect_real_variables(
                slaves[source], variables[source][link], slaves[target], variables[target][link]
            )
    execution.add_observer(CosimObserver.create_to_dir(logs))
    if not execution.step(arm.STEPS):
        raise SystemExit("a step failed")


if __name__ == "__main__":
    main(*sys.argv[1:])

"""The chain as a HELICS federation: `python -m benchmarks.suite.peers.federation ipc|zmq STEPS`.

The plant is granted the times k·h and publishes its state, mission and controller follow within
the same step at offsets. The mission has no inputs and could run ahead.
"""

import multiprocessing
import os
import sys
from typing import Any

from benchmarks.suite.clock import Clock

from .arm import STEP_S, Controller, Plant, reference

# After Pinocchio: HELICS breaks its URDF parser otherwise.
ROLES = ("plant", "controller", "mission")
OFFSET_S = {"plant": 0.0, "mission": 0.0, "controller": STEP_S / 2}


def _federate(helics: Any, core: str, name: str) -> Any:
    info = helics.helicsCreateFederateInfo()
    helics.helicsFederateInfoSetCoreTypeFromString(info, core)
    helics.helicsFederateInfoSetCoreInitString(info, "--federates=1")
    helics.helicsFederateInfoSetTimeProperty(info, helics.helics_property_time_period, STEP_S)
    helics.helicsFederateInfoSetTimeProperty(
        info, helics.helics_property_time_offset, OFFSET_S[name]
    )
    return helics.helicsCreateValueFederate(name, info)


def _take_part(core: str, name: str, steps: int) -> None:
    worker: Any = {"plant": Plant, "controller": Controller, "mission": object}[name]()
    import helics  # noqa: PLC0415

    federate = _federate(helics, core, name)
    data_type = helics.helics_data_type_raw
    out = helics.helicsFederateRegisterGlobalPublication(federate, name, data_type, "")
    sources = {"plant": ("controller",), "controller": ("plant", "mission"), "mission": ()}[name]
    inputs = [helics.helicsFederateRegisterSubscription(federate, key, "") for key in sources]
    helics.helicsFederateEnterExecutingMode(federate)
    publish, get = helics.helicsPublicationPublishBytes, helics.helicsInputGetBytes
    clock = Clock()
    if name == "plant":
        publish(out, worker.state())
    if name == "mission":
        publish(out, reference(0))
    for step in range(steps):
        base = step if name == "controller" else step + 1
        helics.helicsFederateRequestTime(federate, base * STEP_S + OFFSET_S[name])
        if name == "plant":
            worker.step(get(inputs[0]))
            publish(out, worker.state())
            clock.tick()
        elif name == "controller":
            publish(out, worker.torque(get(inputs[0]), get(inputs[1])))
        else:
            publish(out, reference(step + 1))
    if name == "plant":
        clock.show()
    sys.stdout.flush()
    helics.helicsFederateDisconnect(federate)
    os._exit(0)


def main(core: str, steps: int) -> None:
    """Run one federation."""
    import helics  # noqa: PLC0415

    broker = helics.helicsCreateBroker(core, "", f"-f {len(ROLES)}")
    context = multiprocessing.get_context("spawn")
    children = [context.Process(target=_take_part, args=(core, name, steps)) for name in ROLES]
    for child in children:
        child.start()
    for child in children:
        child.join()
    helics.helicsBrokerWaitForDisconnect(broker, 2000)
    helics.helicsCloseLibrary()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))

# mypy: ignore-errors
"""What both federates of the HELICS federation share."""

from typing import Any

import arm
import helics


def join(name: str, offset_s: float) -> Any:
    """Return a federate that is granted the times k · 5 ms + offset."""
    info = helics.helicsCreateFederateInfo()
    helics.helicsFederateInfoSetCoreTypeFromString(info, "zmq")
    helics.helicsFederateInfoSetTimeProperty(info, helics.helics_property_time_period, arm.STEP_S)
    helics.helicsFederateInfoSetTimeProperty(info, helics.helics_property_time_offset, offset_s)
    return helics.helicsCreateValueFederate(name, info)


def publication(federate: Any, key: str) -> Any:
    """Register a vector."""
    kind = helics.helics_data_type_vector
    return helics.helicsFederateRegisterGlobalPublication(federate, key, kind, "")


def leave(federate: Any) -> None:
    """End it."""
    helics.helicsFederateDisconnect(federate)
    helics.helicsFederateFree(federate)
    helics.helicsCloseLibrary()

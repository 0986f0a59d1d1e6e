# mypy: ignore-errors
"""The PD controller as a federate of HELICS: granted half a step after the plant."""

import arm
import helics
from federate import join, leave, publication

OFFSET_S = arm.STEP_S / 2


def main() -> None:
    """Answer each state with a torque."""
    federate = join("controller", OFFSET_S)
    torque = publication(federate, "torque")
    state = helics.helicsFederateRegisterSubscription(federate, "state", "")
    helics.helicsFederateEnterExecutingMode(federate)
    for step in range(arm.STEPS):
        helics.helicsFederateRequestTime(federate, step * arm.STEP_S + OFFSET_S)
        q1, q2, v1, v2 = helics.helicsInputGetVector(state)
        command = arm.control(step, (q1, q2), (v1, v2))
        helics.helicsPublicationPublishVector(torque, list(command))
    leave(federate)


if __name__ == "__main__":
    main()

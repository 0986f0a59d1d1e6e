# mypy: ignore-errors
"""The arm as a federate of HELICS: granted k · 5 ms."""

import arm
import helics
from federate import join, leave, publication


def main() -> None:
    """Publish a state, then apply the torque that answers it."""
    plant, federate = arm.Arm(), join("plant", 0.0)
    state = publication(federate, "state")
    torque = helics.helicsFederateRegisterSubscription(federate, "torque", "")
    helics.helicsFederateEnterExecutingMode(federate)
    helics.helicsPublicationPublishVector(state, [*plant.position, *plant.velocity])
    for step in range(arm.STEPS):
        helics.helicsFederateRequestTime(federate, (step + 1) * arm.STEP_S)
        plant.advance(tuple(helics.helicsInputGetVector(torque)))
        helics.helicsPublicationPublishVector(state, [*plant.position, *plant.velocity])
    leave(federate)


if __name__ == "__main__":
    main()

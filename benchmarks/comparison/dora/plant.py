# mypy: ignore-errors
"""The arm as a node of dora."""

import arm
import numpy as np
import pyarrow as pa
from dora import Node


def main() -> None:
    """Send a state, then wait for the torque that answers it."""
    plant, node = arm.Arm(), Node()
    for _ in range(arm.STEPS):
        node.send_output("state", pa.array([*plant.position, *plant.velocity]))
        event = node.next()
        if event["type"] != "INPUT":
            raise SystemExit(f"{event['type']} at step {plant.step}")
        t1, t2 = np.asarray(event["value"])
        plant.advance((t1, t2))


if __name__ == "__main__":
    main()

# mypy: ignore-errors
"""The PD controller as a node of dora."""

import arm
import numpy as np
import pyarrow as pa
from dora import Node


def main() -> None:
    """Answer each state with a torque."""
    step = 0
    node = Node()
    for event in node:
        if event["type"] == "INPUT":
            q1, q2, v1, v2 = np.asarray(event["value"]).tolist()
            node.send_output("torque", pa.array(arm.control(step, (q1, q2), (v1, v2))))
            step += 1


if __name__ == "__main__":
    main()

"""How well the cube was picked, as a metric of sweeps."""

from typing import Any

import numpy as np


def placed(recording: Any) -> dict[str, float]:
    """Return how far the cube came, from the poses in a recording of `pick`.

    `off`: its last distance from the goal [m], whatever became of the run. `lifted`: how far it was
    above where it stood at the start, at most [m]. `slip`: how far it slid along the pads, at most
    [m].
    """
    params = recording.scenario["participants"]["mission"]["params"]
    poses, names = recording["plant/poses"], list(recording["plant/poses"].names)
    base, cube = (poses["position"][:, names.index(params[key])] for key in ("base", "cube"))
    x, y, _ = params["goal"]
    # The arm stands upright and faces along the x of the world.
    goal = base[-1] + [x, y, cube[0, 2] - base[0, 2]]
    return {
        "off": float(np.linalg.norm(cube[-1] - goal)),
        "lifted": float(np.max(cube[:, 2]) - cube[0, 2]),
        "slip": float(np.max(recording["plant/gripper"]["slip"])),
    }

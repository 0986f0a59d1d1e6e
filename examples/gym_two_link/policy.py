"""A policy of two_link with seven numbers: gains, and what it knows of gravity."""

import json
from pathlib import Path

import numpy as np

GAINS = Path(__file__).with_name("gains.json")
SCALE = np.array([50.0, 50.0, 10.0, 10.0, 10.0, 10.0, 10.0])
"""What one unit of each number means [N·m/rad, N·m·s/rad, N·m]."""


def torque(numbers, observation):
    """Return the torques [N·m] for an observation of two_link, with numbers of shape (7,)."""
    kp, kd, gravity = np.split(np.abs(numbers) * SCALE, [2, 4])
    position, velocity = observation[0:2], observation[2:4]
    wanted, rate = observation[6:8], observation[8:10]
    first, both = np.sin(position[0]), np.sin(position[0] + position[1])
    weight = np.array([gravity[0] * first + gravity[1] * both, gravity[2] * both])
    return kp * (wanted - position) + kd * (rate - velocity) + weight


class Trained:
    """The policy with the gains that `train.py` found."""

    def __init__(self):
        self.numbers = np.array(json.loads(GAINS.read_text()))

    def __call__(self, observation):
        """Return the torques [N·m]."""
        return torque(self.numbers, observation)

# mypy: ignore-errors
"""The arm as an FMU for co-simulation, built by `pythonfmu build -f plant.py arm.py`."""

from arm import Arm
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Plant(Fmi2Slave):
    """Torque in, position and velocity out."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.arm = Arm()
        self.torque1 = self.torque2 = 0.0
        self.q1 = self.q2 = self.v1 = self.v2 = 0.0
        for name in ("torque1", "torque2"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("q1", "q2", "v1", "v2"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        self.arm.advance((self.torque1, self.torque2))
        self.q1, self.q2 = self.arm.position
        self.v1, self.v2 = self.arm.velocity
        return True

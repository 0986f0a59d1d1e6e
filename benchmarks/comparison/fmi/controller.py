# mypy: ignore-errors
"""The PD controller as an FMU for co-simulation."""

from arm import STEP_S, control
from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Controller(Fmi2Slave):
    """Position and velocity in, torque out."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.torque1 = self.torque2 = 0.0
        self.q1 = self.q2 = self.v1 = self.v2 = 0.0
        for name in ("q1", "q2", "v1", "v2"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("torque1", "torque2"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        step = round(current_time / STEP_S)
        self.torque1, self.torque2 = control(step, (self.q1, self.q2), (self.v1, self.v2))
        return True

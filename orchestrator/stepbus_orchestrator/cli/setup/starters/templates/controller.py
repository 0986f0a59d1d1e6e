"""A PD controller: torque = kp · position error + kd · velocity error."""

import stepbus


class Controller(stepbus.Participant):
    def describe(self):
        return {"command": stepbus.Description(like="joint_state")}

    def update(self, step):
        state, wanted = step.read("joint_state"), step.read("reference")
        kp, kd = self.config.params["kp"], self.config.params["kd"]
        rows = zip(wanted.position, state.position, wanted.velocity, state.velocity)
        torque = [kp * (qd - q) + kd * (vd - v) for qd, q, vd, v in rows]
        return {"command": stepbus.JointCommand(mode="torque", values=torque)}


raise SystemExit(stepbus.main(Controller))

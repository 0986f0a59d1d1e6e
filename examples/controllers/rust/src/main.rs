//! A PD controller of the two-link arm: torque = kp (q_d - q) + kd (v_d - v).

use std::collections::BTreeMap;
use std::process::ExitCode;

use stepbus_client::{
    Answer, Description, Error, Field, Inputs, JointCommand, JointReference, JointState,
    Participant, Ports, Welcome,
};

struct Controller {
    /// Gain of the position error [N·m/rad].
    kp: f64,
    /// Gain of the velocity error [N·m·s/rad].
    kd: f64,
    /// Index of each joint in the reference.
    in_reference: Vec<usize>,
}

impl Participant for Controller {
    const INPUTS: Ports =
        Some(&[("joint_state", "JointState/1"), ("reference", "JointReference/1")]);
    const OUTPUTS: Ports = Some(&[("command", "JointCommand/1")]);

    /// Reads the `params` of the scenario; a model would be loaded here.
    fn load(welcome: &Welcome) -> Result<Self, Error> {
        let gain = |name: &str| {
            let value = welcome.params.get(name);
            let value = value.ok_or_else(|| Error::Wiring(format!("params has no {name}")))?;
            f64::read(value).map_err(|error| Error::Wiring(format!("params.{name}: {error}")))
        };
        Ok(Self { kp: gain("kp")?, kd: gain("kd")?, in_reference: Vec::new() })
    }

    /// The command has the joints of the state, in their order.
    fn describe(&self) -> BTreeMap<String, Description> {
        BTreeMap::from([("command".to_owned(), Description::like("joint_state"))])
    }

    /// Finds each joint of the state in the reference.
    fn start(&mut self, inputs: &BTreeMap<String, Description>) -> Result<(), Error> {
        let (state, reference) = (&inputs["joint_state"].names, &inputs["reference"].names);
        let place = |joint: &String| {
            let found = reference.iter().position(|name| name == joint);
            found.ok_or_else(|| Error::Wiring(format!("the reference has no joint {joint}")))
        };
        self.in_reference = state.iter().map(place).collect::<Result<_, _>>()?;
        Ok(())
    }

    /// Does one step; without its inputs there is no command.
    fn update(&mut self, _step: i64, inputs: &Inputs) -> Result<Answer, Error> {
        let state: Option<JointState> = inputs.get("joint_state")?;
        let reference: Option<JointReference> = inputs.get("reference")?;
        let (Some(state), Some(reference)) = (state, reference) else {
            return Ok(Answer::default());
        };
        let (Some(q), Some(v)) = (state.position, state.velocity) else {
            return Err(Error::raised("the arm senses no position or no velocity"));
        };
        let torque = |(i, &r): (usize, &usize)| {
            self.kp * (reference.position[r] - q[i]) + self.kd * (reference.velocity[r] - v[i])
        };
        let torques = self.in_reference.iter().enumerate().map(torque).collect();
        Ok(Answer::default().with("command", &JointCommand::torque(torques)))
    }
}

fn main() -> ExitCode {
    stepbus_client::run::<Controller>()
}

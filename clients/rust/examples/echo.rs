//! Plant, controller and mission that compute nothing, for the benchmarks: `echo ROLE`.
//!
//! The same as `benchmarks/echo/echo.py`.

use std::collections::BTreeMap;
use std::process::ExitCode;

use stepbus_client::{
    Answer, Description, Error, Inputs, JointCommand, JointReference, JointState, Participant,
    Welcome,
};

const NAMES: [&str; 2] = ["joint1", "joint2"];

fn pair() -> Vec<f64> {
    vec![0.25; 2]
}

struct Plant;

impl Participant for Plant {
    fn load(_: &Welcome) -> Result<Self, Error> {
        Ok(Plant)
    }

    fn describe(&self) -> BTreeMap<String, Description> {
        BTreeMap::from([("joint_state".to_owned(), Description::named(&NAMES))])
    }

    fn state(&mut self, _step: i64) -> Result<Answer, Error> {
        let state = JointState {
            position: Some(pair()),
            velocity: Some(pair()),
            effort: Some(pair()),
            target: None,
        };
        Ok(Answer::default().with("joint_state", &state))
    }

    fn update(&mut self, _step: i64, inputs: &Inputs) -> Result<Answer, Error> {
        inputs.get::<JointCommand>("command")?;
        Ok(Answer::default())
    }
}

struct Controller;

impl Participant for Controller {
    fn load(_: &Welcome) -> Result<Self, Error> {
        Ok(Controller)
    }

    fn describe(&self) -> BTreeMap<String, Description> {
        BTreeMap::from([("command".to_owned(), Description::named(&NAMES))])
    }

    fn update(&mut self, _step: i64, inputs: &Inputs) -> Result<Answer, Error> {
        inputs.get::<JointReference>("reference")?;
        let state = inputs.get::<JointState>("joint_state")?;
        let values = state.and_then(|state| state.position).unwrap_or_default();
        Ok(Answer::default().with("command", &JointCommand::torque(values)))
    }
}

struct Mission;

impl Participant for Mission {
    fn load(_: &Welcome) -> Result<Self, Error> {
        Ok(Mission)
    }

    fn describe(&self) -> BTreeMap<String, Description> {
        BTreeMap::from([("reference".to_owned(), Description::named(&NAMES))])
    }

    fn update(&mut self, _step: i64, _inputs: &Inputs) -> Result<Answer, Error> {
        let reference = JointReference { position: pair(), velocity: pair(), acceleration: pair() };
        Ok(Answer::default().with("reference", &reference))
    }
}

fn main() -> ExitCode {
    match std::env::args().nth(1).as_deref() {
        Some("plant") => stepbus_client::run::<Plant>(),
        Some("controller") => stepbus_client::run::<Controller>(),
        Some("mission") => stepbus_client::run::<Mission>(),
        _ => {
            eprintln!("usage: echo plant|controller|mission");
            ExitCode::from(2)
        }
    }
}

//! The depth controller of stepbus' `examples/thruster`, with message types of its own.

use std::collections::BTreeMap;
use std::process::ExitCode;

use stepbus_client::{
    declared, message, Answer, Description, Error, Field, Inputs, Participant, Types, Welcome,
};

message! {
    /// Commands to the thrusters.
    "Thruster/1",
    struct Thruster {
        /// Upward thrust of each thruster [N].
        thrust: Vec<f64> as "float[n]" in "N",
        /// `off`: the thrusters stand still.
        mode: String as "off | on",
    }
}

message! {
    /// What the depth sensor measures.
    "Depth/1",
    struct Depth {
        /// Depth below the surface [m].
        depth: f64 as "float" in "m",
        /// Downward velocity [m/s].
        rate: f64 as "float" in "m/s",
    }
}

struct Controller {
    /// target [m], kp [N/m], kd [N·s/m], ki [N/(m·s)].
    gains: [f64; 4],
    /// Length of a step [s].
    dt: f64,
    sum: f64,
}

impl Participant for Controller {
    const TYPES: Types = &[declared::<Thruster>, declared::<Depth>];

    fn load(welcome: &Welcome) -> Result<Self, Error> {
        let gain = |name: &str| match welcome.params.get(name).map(f64::read) {
            Some(Ok(value)) => Ok(value),
            _ => Err(Error::Wiring(format!("params has no number {name}"))),
        };
        let gains = [gain("target")?, gain("kp")?, gain("kd")?, gain("ki")?];
        let dt = welcome.step_ns.get() as f64 * 1e-9;
        Ok(Self { gains, dt, sum: 0.0 })
    }

    fn describe(&self) -> BTreeMap<String, Description> {
        BTreeMap::from([("thruster".to_owned(), Description::named(&["left", "right"]))])
    }

    fn update(&mut self, _step: i64, inputs: &Inputs) -> Result<Answer, Error> {
        let Some(Depth { depth, rate }) = inputs.get("depth")? else {
            let thrust = vec![0.0; 2];
            return Ok(Answer::default().with("thruster", &Thruster { thrust, mode: "off".into() }));
        };
        let [target, kp, kd, ki] = self.gains;
        let error = depth - target;
        self.sum += error * self.dt;
        let thrust = vec![(kp * error + kd * rate + ki * self.sum) / 2.0; 2];
        Ok(Answer::default().with("thruster", &Thruster { thrust, mode: "on".into() }))
    }
}

fn main() -> ExitCode {
    stepbus_client::run::<Controller>()
}

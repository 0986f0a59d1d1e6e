//! Messages of ports; their units and shapes are in stepbus' `docs/reference/messages.md`.

use crate::codec::{Field, Malformed, Message, Value};
use crate::message;

message! {
    /// What the joints do. Each field has shape (n,) and is absent where it is not sensed.
    "JointState/1",
    struct JointState {
        /// Measured positions [rad].
        position: Option<Vec<f64>>,
        /// Measured velocities [rad/s].
        velocity: Option<Vec<f64>>,
        /// Torques the motors applied [N·m].
        effort: Option<Vec<f64>>,
        /// Newest position targets [rad].
        target: Option<Vec<f64>>,
    }
}

message! {
    /// Where the joints should be. Each field has shape (n,).
    "JointReference/1",
    struct JointReference {
        /// Desired positions [rad].
        position: Vec<f64>,
        /// Desired velocities [rad/s].
        velocity: Vec<f64>,
        /// Desired accelerations [rad/s²].
        acceleration: Vec<f64>,
    }
}

message! {
    /// Joint commands, valid from this step on. Each vector has shape (n,).
    "JointCommand/1",
    struct JointCommand {
        /// What `values` mean.
        mode: Mode,
        /// By mode: torques [N·m], velocities [rad/s] or positions [rad].
        values: Vec<f64>,
        /// Feed-forward of mode position, start velocity of mode teleport [rad/s].
        velocity: Option<Vec<f64>>,
        /// Largest torque of modes velocity and position [N·m].
        effort_limit: Option<Vec<f64>>,
    }
}

impl JointCommand {
    /// Commands torques [N·m], shape (n,).
    pub fn torque(values: Vec<f64>) -> Self {
        Self { mode: Mode::Torque, values, velocity: None, effort_limit: None }
    }
}

/// What the values of a `JointCommand` mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mode {
    /// Brakes on; the values are not read.
    Brake,
    /// Positions to hold [rad].
    Position,
    /// Positions to jump to [rad].
    Teleport,
    /// Torques [N·m].
    Torque,
    /// Velocities [rad/s].
    Velocity,
}

const MODES: [(&str, Mode); 5] = [
    ("brake", Mode::Brake),
    ("position", Mode::Position),
    ("teleport", Mode::Teleport),
    ("torque", Mode::Torque),
    ("velocity", Mode::Velocity),
];

impl Field for Mode {
    fn read(value: &Value) -> Result<Self, Malformed> {
        let row = MODES.iter().find(|(word, _)| value.as_str() == Some(word));
        row.map(|(_, mode)| *mode)
            .ok_or_else(|| Malformed::new("brake, position, teleport, torque or velocity"))
    }

    fn write(&self) -> Value {
        let row = MODES.iter().find(|(_, mode)| mode == self);
        row.map(|(word, _)| Value::from(*word)).expect("each mode has a word")
    }
}

message! {
    /// How a controller does.
    "ControllerStatus/1",
    struct ControllerStatus {
        /// Reference minus measured position [rad], shape (n,).
        error: Vec<f64>,
        /// Whether the command was cut at its limit, shape (n,).
        saturated: Vec<bool>,
        /// Warnings of the controller.
        warnings: Vec<String> = Vec::new(),
    }
}

/// Checks a message of a type known here; of any other type, only that it is a map.
pub(crate) fn check(type_name: &str, value: &Value) -> Result<(), Malformed> {
    match type_name {
        JointState::TYPE => JointState::read(value).map(drop),
        JointReference::TYPE => JointReference::read(value).map(drop),
        JointCommand::TYPE => JointCommand::read(value).map(drop),
        ControllerStatus::TYPE => ControllerStatus::read(value).map(drop),
        _ if value.is_map() => Ok(()),
        _ => Err(Malformed::new("a map")),
    }
}

//! The envelopes between participant and orchestrator (clause P3.1).

use std::collections::BTreeMap;
use std::num::NonZeroU64;

use crate::codec::{Field, Malformed, Value};
use crate::message;

type Map<T> = BTreeMap<String, T>;

message! {
    /// A participant asks to join.
    "Hello/1",
    struct Hello {
        /// Highest version of the protocol that the program speaks.
        protocol: i64,
        /// Name of the participant.
        name: String,
        /// The run's secret.
        token: String,
        /// Process id.
        pid: i64,
        /// Programming language of the program.
        language: String = String::new(),
        /// Client library of the program.
        sdk: String = String::new(),
        /// Input ports the program knows, with their types; none: any.
        inputs: Option<Map<String>>,
        /// Output ports the program knows, with their types; none: any.
        outputs: Option<Map<String>>,
        /// Declarations of the types that do not ship with stepbus, as the program knows them.
        types: Map<Map<Value>> = Map::new(),
        /// Whether the program takes a `Batch` in place of an `Outputs`.
        batches: bool = false,
        /// Lowest version of the protocol that the program speaks; none: `protocol` only.
        lowest_protocol: Option<i64>,
    }
}

message! {
    /// The orchestrator admits a participant and sends its configuration.
    "Welcome/1",
    struct Welcome {
        /// Version of the protocol that both speak.
        protocol: i64,
        /// Name of the participant.
        name: String,
        /// The run's secret.
        token: String,
        /// Length of a step [ns].
        step_ns: NonZeroU64,
        /// The participant fires at multiples of this [steps].
        every: NonZeroU64,
        /// Whether it publishes before or after it reads.
        publishes: Publishes,
        /// Maximum number of steps in flight.
        window: NonZeroU64,
        /// Maximum number of `Outputs` in one `Log`.
        batch: NonZeroU64,
        /// The participant's own seed.
        seed: u64,
        /// Input → its source.
        inputs: Map<InputConfig>,
        /// Output → its type.
        outputs: Map<OutputConfig>,
        /// The participant's `params`, as written in the scenario.
        params: Map<Value>,
        /// Folder for relative file names in `params`.
        folder: String,
        /// Largest `Outputs` the bus carries [bytes].
        max_outputs_bytes: NonZeroU64 = NonZeroU64::new(60_000).expect("not zero"),
        /// Declarations of the types of its ports that do not ship with stepbus.
        types: Map<Map<Value>> = Map::new(),
    }
}

/// Whether the outputs of a step are published before or after its inputs are read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Publishes {
    /// Before: the state, for example of a plant.
    First,
    /// After: a response, for example of a controller.
    Last,
}

impl Field for Publishes {
    fn read(value: &Value) -> Result<Self, Malformed> {
        match value.as_str() {
            Some("first") => Ok(Self::First),
            Some("last") => Ok(Self::Last),
            _ => Err(Malformed::new("first or last")),
        }
    }

    fn write(&self) -> Value {
        Value::from(if *self == Self::First { "first" } else { "last" })
    }
}

message! {
    /// Source and timing of one input.
    "InputConfig",
    struct InputConfig {
        /// Name of the source.
        source: String,
        /// Name of the source's output.
        port: String,
        /// Message type, `Name/major`.
        r#type: String,
        /// Minimum age of the source's output [steps].
        delay: u64 = 0,
        /// The source fires at multiples of this [steps].
        every: NonZeroU64 = NonZeroU64::MIN,
        /// Whether the content travels on its own key.
        bulk: bool = false,
    }
}

message! {
    /// Type and transport of one output.
    "OutputConfig",
    struct OutputConfig {
        /// Message type, `Name/major`.
        r#type: String,
        /// Whether the content travels on its own key.
        bulk: bool = false,
    }
}

message! {
    /// The orchestrator refuses a participant.
    "Refusal/1",
    struct Refusal {
        /// Message for the user.
        reason: String,
    }
}

message! {
    /// Description of one output: names, order and limits of its vectors.
    "Description",
    struct Description {
        /// Names of joints, wheels or cameras, in the order of every vector of the port.
        names: Vec<String> = Vec::new(),
        /// Input whose names apply to this output too.
        like: Option<String>,
        /// Unit of each field, where it differs from the type's.
        units: Map<String> = Map::new(),
        /// `lower`, `upper`, `velocity`, `effort`, in the order of the names.
        limits: Map<Vec<f64>> = Map::new(),
        /// Shape of bulk data.
        shape: Vec<i64> = Vec::new(),
        /// Further properties per name.
        details: Map<Vec<String>> = Map::new(),
    }
}

impl Description {
    /// Describes an output whose names are those of an input.
    pub fn like(input: &str) -> Self {
        Self { like: Some(input.to_owned()), ..Self::named(&[]) }
    }

    /// Describes an output by the names of its vectors.
    pub fn named(names: &[&str]) -> Self {
        let nothing = Self::read(&Value::Map(Vec::new())).expect("all fields have defaults");
        Self { names: names.iter().map(ToString::to_string).collect(), ..nothing }
    }
}

message! {
    /// The model is loaded and every source is connected.
    "Ready/1",
    struct Ready {
        /// Name of the participant.
        name: String,
        /// The run's secret.
        token: String,
        /// Output → its description.
        outputs: Map<Description> = Map::new(),
        /// Versions of the libraries that affect the result.
        versions: Map<String> = Map::new(),
        /// Name → method that can be called; this crate offers none.
        calls: Map<CallDescription> = Map::new(),
        /// Bulk outputs whose slot file it has opened; this crate opens none.
        slots: Vec<String> = Vec::new(),
    }
}

message! {
    /// A method of a participant that can be called between two steps.
    "CallDescription",
    struct CallDescription {
        /// Arguments and answer in one line.
        help: String,
        /// Whether it may change the result.
        changes: bool = false,
    }
}

message! {
    /// All are ready; the descriptions of each participant's inputs.
    "Start/1",
    struct Start {
        /// The run's secret.
        token: String,
        /// Participant → its input → description.
        inputs: Map<Map<Description>>,
        /// Participant → maximum number of `Outputs` in one `Batch`.
        batches: Map<NonZeroU64> = Map::new(),
        /// Bulk output that uses slots → number of slots.
        slots: Map<NonZeroU64> = Map::new(),
    }
}

message! {
    /// Permission to work on all steps below `step_limit`.
    "Trigger/1",
    struct Trigger {
        /// The run's secret.
        token: String,
        /// First step not released yet.
        step_limit: u64,
    }
}

message! {
    /// The run ends.
    "Stop/1",
    struct Stop {
        /// The run's secret.
        token: String,
        /// Why the run ends.
        reason: String,
        /// The step to end at; negative: now.
        at_step: i64,
    }
}

message! {
    /// All outputs of a participant at one step.
    "Outputs/1",
    struct Outputs {
        /// The run's secret.
        token: String,
        /// Number of the step; -1: a handshake.
        step: i64,
        /// Simulation time [ns].
        t_ns: i64,
        /// Output → its message.
        ports: Map<Value> = Map::new(),
        /// Bulk ports, with the length of their content [bytes].
        bulk: Map<u64> = Map::new(),
        /// Bulk ports whose content is in a slot → offset of the slot in the file [bytes].
        slots: Map<u64> = Map::new(),
        /// Why the run should end after this step.
        end: Option<String>,
    }
}

message! {
    /// Several steps of a participant that no other waits for, in one message.
    "Batch/1",
    struct Batch {
        /// The run's secret.
        token: String,
        /// `Outputs`, in the order of their steps.
        outputs: Vec<Value>,
    }
}

message! {
    /// What a participant waits for; no sources: the trigger.
    "Waiting",
    struct Waiting {
        /// The step it waits to do.
        step: i64,
        /// Participants whose outputs have not arrived.
        sources: Vec<String>,
    }
}

message! {
    /// A participant cannot continue.
    "Fault/1",
    struct Fault {
        /// Name of the participant.
        name: String,
        /// The run's secret.
        token: String,
        /// The step it was executing; negative: before the first.
        step: i64,
        /// `raised`, `message`, `wiring` or `bus`.
        r#type: String,
        /// Message for the user.
        message: String,
        /// Where in the program it happened.
        traceback: String = String::new(),
        /// Whose fault it is, when it is not the sender's own.
        blames: Option<String>,
    }
}

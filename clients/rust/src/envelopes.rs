//! What participant and orchestrator send each other (clause P3.1).

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
        /// What the program is written in.
        language: String = String::new(),
        /// Library it takes part with.
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
    /// The orchestrator admits a participant and sends it all it needs.
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
        /// How many steps may be in flight.
        window: NonZeroU64,
        /// How many `Outputs` at most go into one `Log`.
        batch: NonZeroU64,
        /// Seed of the participant's own.
        seed: u64,
        /// Input → where it comes from.
        inputs: Map<InputConfig>,
        /// Output → what it publishes.
        outputs: Map<OutputConfig>,
        /// The participant's `params`, as written in the scenario.
        params: Map<Value>,
        /// The folder that relative file names in `params` are relative to.
        folder: String,
        /// Largest `Outputs` the bus carries [bytes].
        max_outputs_bytes: NonZeroU64 = NonZeroU64::new(60_000).expect("not zero"),
        /// Declarations of the types of its ports that do not ship with stepbus.
        types: Map<Map<Value>> = Map::new(),
    }
}

/// Whether outputs of a step come before or after its inputs are read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Publishes {
    /// Before: the state, as of a plant.
    First,
    /// After: an answer, as of a controller.
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
    /// Where one input comes from and when.
    "InputConfig",
    struct InputConfig {
        /// Participant it comes from.
        source: String,
        /// That participant's output.
        port: String,
        /// Message type, `Name/major`.
        r#type: String,
        /// How old the source's output has to be at least [steps].
        delay: u64 = 0,
        /// The source fires at multiples of this [steps].
        every: NonZeroU64 = NonZeroU64::MIN,
        /// Whether the content travels on a key of its own.
        bulk: bool = false,
    }
}

message! {
    /// What one output publishes.
    "OutputConfig",
    struct OutputConfig {
        /// Message type, `Name/major`.
        r#type: String,
        /// Whether the content travels on a key of its own.
        bulk: bool = false,
    }
}

message! {
    /// The orchestrator does not take a participant in.
    "Refusal/1",
    struct Refusal {
        /// One sentence for the user.
        reason: String,
    }
}

message! {
    /// What one output carries, in which order, within which limits.
    "Description",
    struct Description {
        /// Names of joints, wheels or cameras, in the order of every vector of the port.
        names: Vec<String> = Vec::new(),
        /// An input whose names hold for this output too.
        like: Option<String>,
        /// Unit of each field, where it differs from the type's.
        units: Map<String> = Map::new(),
        /// `lower`, `upper`, `velocity`, `effort`, in the order of the names.
        limits: Map<Vec<f64>> = Map::new(),
        /// Shape of bulk data.
        shape: Vec<i64> = Vec::new(),
        /// Anything else worth telling per name.
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
        /// Versions of the libraries that shape the result.
        versions: Map<String> = Map::new(),
        /// Name → what the participant can be asked; this crate answers nothing.
        calls: Map<CallDescription> = Map::new(),
        /// Bulk outputs whose file of slots it has opened; this crate opens none.
        slots: Vec<String> = Vec::new(),
    }
}

message! {
    /// Something a participant can be asked between two steps.
    "CallDescription",
    struct CallDescription {
        /// Arguments and answer in one line.
        help: String,
        /// Whether it changes the result.
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
        /// Participant → how many `Outputs` it may publish in one `Batch`.
        batches: Map<NonZeroU64> = Map::new(),
        /// Bulk output whose content goes through slots → their number.
        slots: Map<NonZeroU64> = Map::new(),
    }
}

message! {
    /// Permission to work on all steps below `step_limit`.
    "Trigger/1",
    struct Trigger {
        /// The run's secret.
        token: String,
        /// First step that is not yet allowed.
        step_limit: u64,
    }
}

message! {
    /// The run ends.
    "Stop/1",
    struct Stop {
        /// The run's secret.
        token: String,
        /// Why, one sentence.
        reason: String,
        /// The step to end at; negative: now.
        at_step: i64,
    }
}

message! {
    /// All a participant publishes at one step.
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
        /// Bulk ports whose content is in a slot → where that begins in the file [bytes].
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
        /// The step it was at; negative: before the first.
        step: i64,
        /// `raised`, `message`, `wiring` or `bus`.
        r#type: String,
        /// One sentence for the user.
        message: String,
        /// Where in the program it happened.
        traceback: String = String::new(),
        /// Whose fault it is, when it is not the sender's own.
        blames: Option<String>,
    }
}

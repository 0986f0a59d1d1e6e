//! What a program of yours is made of.

use std::collections::BTreeMap;

use crate::codec::{Declaration, Message, Value};
use crate::envelopes::{Description, InputConfig, OutputConfig, Welcome};
use crate::error::Error;
use crate::messages;
use crate::source::Source;

/// Ports a program knows, with their types: `&[("joint_state", "JointState/1")]`.
pub type Ports = Option<&'static [(&'static str, &'static str)]>;

/// Message types of a program's own: `&[declared::<Thruster>]`.
pub type Types = &'static [fn() -> (String, Declaration)];

/// A plant, a controller, a mission, or anything else that takes part in a run.
///
/// Inputs, parameters, seed and step number have to be all that decides what it publishes: no
/// clock, no chance but that of the seed.
pub trait Participant: Sized {
    /// The inputs it works with, if it only works with certain ones; the run checks them.
    const INPUTS: Ports = None;
    /// The outputs it works with, likewise.
    const OUTPUTS: Ports = None;
    /// The types of its own that it knows; the run compares their declarations with the scenario's.
    const TYPES: Types = &[];

    /// Loads the model; file names in `params` are relative to `welcome.folder`.
    fn load(welcome: &Welcome) -> Result<Self, Error>;

    /// Describes each output.
    fn describe(&self) -> BTreeMap<String, Description>;

    /// Receives the descriptions of its inputs; find your joints there by name.
    fn start(&mut self, _inputs: &BTreeMap<String, Description>) -> Result<(), Error> {
        Ok(())
    }

    /// With `publishes: first`: returns the outputs of a step, before its inputs are there.
    fn state(&mut self, _step: i64) -> Result<Answer, Error> {
        Ok(Answer::default())
    }

    /// Does a step. Returns its outputs; with `publishes: first`, nothing reads them.
    fn update(&mut self, step: i64, inputs: &Inputs) -> Result<Answer, Error>;
}

/// The inputs of a step.
pub struct Inputs<'a>(pub(crate) &'a [Source]);

impl Inputs<'_> {
    /// Returns the message of an input; none while the input is absent.
    ///
    /// Says `Error::Wiring` where there is no such input, or one of another type.
    pub fn get<T: Message>(&self, port: &str) -> Result<Option<T>, Error> {
        let (config, value) = self.find(port)?;
        if config.r#type != T::TYPE {
            let (is, reads) = (&config.r#type, T::TYPE);
            return Err(Error::Wiring(format!("input {port} is {is}, the program reads {reads}")));
        }
        let message = value.map(T::read).transpose();
        message.map_err(|error| Error::Message {
            text: format!("{} published a malformed {}: {error}", config.source, config.port),
            blames: Some(config.source.clone()),
        })
    }

    /// Returns the message of an input of any type as a value; none while the input is absent.
    pub fn value(&self, port: &str) -> Result<Option<&Value>, Error> {
        self.find(port).map(|(_, value)| value)
    }

    fn find(&self, port: &str) -> Result<(&InputConfig, Option<&Value>), Error> {
        let mut all = self.0.iter().flat_map(Source::held);
        all.find(|(name, _, _)| *name == port)
            .map(|(_, config, value)| (config, value))
            .ok_or_else(|| Error::Wiring(format!("the scenario gives no input {port}")))
    }
}

/// What a participant publishes at a step. A port that is left out is held by its consumers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Answer {
    ports: BTreeMap<String, (Value, Option<&'static str>)>,
    /// Asks for the end of the run after this step: a sentence that says why.
    pub end: Option<String>,
}

impl Answer {
    /// Adds a message.
    pub fn with<T: Message>(mut self, port: &str, message: &T) -> Self {
        self.ports.insert(port.to_owned(), (message.write(), Some(T::TYPE)));
        self
    }

    /// Adds a message of any type, as a map.
    pub fn with_value(mut self, port: &str, message: Value) -> Self {
        self.ports.insert(port.to_owned(), (message, None));
        self
    }

    /// Checks the ports against those of the scenario (P7.2) and returns their messages.
    pub(crate) fn checked(
        self,
        outputs: &BTreeMap<String, OutputConfig>,
    ) -> Result<BTreeMap<String, Value>, Error> {
        let check = |(port, (value, made)): (String, (Value, Option<&str>))| {
            let Some(OutputConfig { r#type, .. }) = outputs.get(&port) else {
                return Err(Error::Wiring(format!("the scenario has no output {port}")));
            };
            if let Some(made) = made.filter(|made| made != r#type) {
                return Err(Error::Wiring(format!("output {port} is {type}, not {made}")));
            }
            match messages::check(r#type, &value) {
                Ok(()) => Ok((port, value)),
                Err(error) => Err(Error::Message {
                    text: format!("output {port} is not a {type}: {error}"),
                    blames: None,
                }),
            }
        };
        self.ports.into_iter().map(check).collect()
    }
}

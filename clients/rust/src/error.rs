//! Why a participant cannot continue (clause P10.2).

use std::fmt;

use crate::codec::Malformed;

/// The cause of a fault; each holds one sentence for the user.
#[derive(Clone, Debug, PartialEq)]
pub enum Error {
    /// Bytes that are not what they should be; `blames` is their sender, if that is a peer.
    Message {
        /// The sentence.
        text: String,
        /// Whose fault it is.
        blames: Option<String>,
    },
    /// A scenario that cannot work as it is.
    Wiring(String),
    /// The bus itself.
    Bus(String),
    /// Anything else.
    Raised {
        /// The sentence.
        text: String,
        /// Where in the program it happened.
        traceback: String,
    },
}

impl Error {
    /// Anything that goes wrong in a participant's own work.
    pub fn raised(text: impl fmt::Display) -> Self {
        let (text, traceback) = (text.to_string(), String::new());
        Self::Raised { text, traceback }
    }

    /// The word of the protocol.
    pub fn fault_type(&self) -> &'static str {
        match self {
            Self::Message { .. } => "message",
            Self::Wiring(_) => "wiring",
            Self::Bus(_) => "bus",
            Self::Raised { .. } => "raised",
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Message { text, .. } | Self::Raised { text, .. } => f.write_str(text),
            Self::Wiring(text) | Self::Bus(text) => f.write_str(text),
        }
    }
}

impl std::error::Error for Error {}

/// A parameter of the scenario that is not what the participant reads.
impl From<Malformed> for Error {
    fn from(malformed: Malformed) -> Self {
        Self::Wiring(malformed.to_string())
    }
}

impl From<zenoh::Error> for Error {
    fn from(error: zenoh::Error) -> Self {
        Self::Bus(error.to_string())
    }
}

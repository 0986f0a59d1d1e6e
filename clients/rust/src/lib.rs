//! Take part in a run of stepbus: protocol 2 over Zenoh.
//!
//! Implement [`Participant`] and hand it to [`run`]. Written from stepbus' `docs/protocol.md`;
//! `P7.3` in a comment is a clause of that page.

#![warn(missing_docs)]

mod batch;
mod bus;
pub mod codec;
pub mod envelopes;
mod error;
pub mod messages;
mod participant;
mod run;
mod session;
mod source;
mod ticket;

pub use codec::{declared, Field, Value};
pub use envelopes::{Description, Welcome};
pub use error::Error;
pub use messages::{ControllerStatus, JointCommand, JointReference, JointState, Mode};
pub use participant::{Answer, Inputs, Participant, Ports, Types};
pub use run::run;

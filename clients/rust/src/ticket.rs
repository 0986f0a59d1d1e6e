//! The ticket: where the run is, and who one is in it (clause P1).

use std::collections::BTreeMap;
use std::time::Duration;

use serde::Deserialize;

/// What the orchestrator hands to a participant when it starts it.
#[derive(Clone, Debug, Deserialize)]
pub struct Ticket {
    /// Names the key space, `stepbus/<run>/`.
    pub run: String,
    /// Name of the participant.
    pub name: String,
    /// The run's secret.
    pub token: String,
    /// Where to listen and to connect.
    pub endpoint: Endpoint,
    #[serde(default = "ten")]
    join_timeout_s: f64,
}

/// How to reach the others.
#[derive(Clone, Debug, Deserialize)]
pub struct Endpoint {
    /// Zenoh endpoints to listen on.
    pub listen: Vec<String>,
    /// Zenoh endpoints to link to.
    pub connect: Vec<String>,
    /// Which transport to use.
    #[serde(default = "yes")]
    pub low_latency: bool,
    /// Who you are.
    pub user: Option<String>,
    /// What proves it.
    pub password: Option<String>,
    /// User → password: who may connect.
    #[serde(default)]
    pub users: BTreeMap<String, String>,
    /// Further Zenoh settings: path in Zenoh's own tree → value (P2.4).
    #[serde(default)]
    pub settings: BTreeMap<String, serde_json::Value>,
}

fn ten() -> f64 {
    10.0
}

fn yes() -> bool {
    true
}

impl Ticket {
    /// Reads the file that `STEPBUS_TICKET` names; else says in a sentence what is missing.
    pub fn from_environment() -> Result<Self, String> {
        let path = std::env::var("STEPBUS_TICKET")
            .map_err(|_| "STEPBUS_TICKET is not set; is this started by `stepbus run`?")?;
        let text = std::fs::read_to_string(&path)
            .map_err(|error| format!("cannot read the ticket {path}: {error}"))?;
        Self::parse(&text).map_err(|error| format!("{path} is no ticket: {error}"))
    }

    fn parse(text: &str) -> Result<Self, String> {
        let ticket: Self = serde_json::from_str(text).map_err(|error| error.to_string())?;
        let timeout = Duration::try_from_secs_f64(ticket.join_timeout_s);
        timeout.map(|_| ticket).map_err(|error| format!("join_timeout_s: {error}"))
    }

    /// How long to keep asking to join.
    pub fn join_timeout(&self) -> Duration {
        Duration::from_secs_f64(self.join_timeout_s)
    }
}

#[cfg(test)]
mod tests {
    use super::Ticket;

    const ENDPOINT: &str = r#"{"listen": [], "connect": ["tcp/[::1]:7"]}"#;

    #[test]
    fn absent_fields_have_their_defaults_and_unknown_ones_are_ignored() {
        let text = format!(r#"{{"run":"r","name":"n","token":"t","new":1,"endpoint":{ENDPOINT}}}"#);
        let ticket = Ticket::parse(&text).unwrap();
        assert!(ticket.endpoint.low_latency && ticket.endpoint.user.is_none());
        assert_eq!(ticket.join_timeout().as_secs(), 10);
    }

    #[test]
    fn a_negative_time_is_refused() {
        let rest = format!(r#""endpoint":{ENDPOINT},"join_timeout_s":-1"#);
        let text = format!(r#"{{"run":"r","name":"n","token":"t",{rest}}}"#);
        assert!(Ticket::parse(&text).unwrap_err().contains("join_timeout_s"));
    }
}

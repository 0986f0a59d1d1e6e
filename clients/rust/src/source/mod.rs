//! What one source has published, and which of it is due (clauses P6 and P8.1).

use std::collections::{BTreeMap, VecDeque};

use crate::codec::{self, pack, Field, Value};
use crate::envelopes::{Batch, InputConfig, Outputs};
use crate::error::Error;
use crate::messages;

/// Messages dropped so far, by cause.
pub type Drops = BTreeMap<String, u64>;

/// One input: what it holds, and where that comes from.
pub struct Input {
    name: String,
    config: InputConfig,
    held: Option<Value>,
    taken: i64,
}

impl Input {
    /// Returns the step whose outputs are due at step k; negative: none.
    fn due(&self, k: i64) -> i64 {
        let reach = k.saturating_sub_unsigned(self.config.delay);
        reach - reach.rem_euclid(self.config.every.get() as i64)
    }

    fn take(&mut self, outputs: &Outputs) -> Result<(), Error> {
        self.taken = outputs.step;
        let InputConfig { source, port, r#type, .. } = &self.config;
        if let Some(value) = outputs.ports.get(port) {
            messages::check(r#type, value).map_err(|error| Error::Message {
                text: format!(
                    "{source} published a malformed {port} at step {}: {error}",
                    self.taken
                ),
                blames: Some(source.clone()),
            })?;
            self.held = Some(value.clone());
        }
        Ok(())
    }
}

/// A participant from which one or more inputs come.
pub struct Source {
    /// Name of the participant.
    pub name: String,
    /// Whether its link is proved.
    pub connected: bool,
    every: i64,
    newest: i64,
    newest_bytes: Vec<u8>,
    ahead: VecDeque<Outputs>,
    inputs: Vec<Input>,
}

impl Source {
    /// Groups the inputs of a participant by their source.
    pub fn all(configs: &BTreeMap<String, InputConfig>) -> Vec<Self> {
        let mut sources = BTreeMap::new();
        for (name, config) in configs {
            let source = sources.entry(&config.source).or_insert_with(|| Self::new(config));
            let (name, config) = (name.clone(), config.clone());
            source.inputs.push(Input { name, config, held: None, taken: -1 });
        }
        sources.into_values().collect()
    }

    fn new(config: &InputConfig) -> Self {
        let every = config.every.get() as i64;
        Self {
            name: config.source.clone(),
            connected: false,
            every,
            newest: -every,
            newest_bytes: Vec::new(),
            ahead: VecDeque::new(),
            inputs: Vec::new(),
        }
    }

    /// Takes in a payload of `out/<source>`: keeps it, drops it, or says what is wrong.
    pub fn accept(&mut self, bytes: &[u8], token: &str, drops: &mut Drops) -> Result<(), Error> {
        let Ok(value) = codec::unpack(bytes) else {
            return count(drops, "malformed");
        };
        if let Ok(batch) = Batch::read(&value) {
            if batch.token != token {
                return count(drops, "unauthenticated");
            }
            // Each entry counts as a message of its own (P7.6).
            let mut entries = batch.outputs.iter();
            return entries
                .try_for_each(|entry| self.accept_one(entry, &pack(entry), token, drops));
        }
        self.accept_one(&value, bytes, token, drops)
    }

    fn accept_one(
        &mut self,
        value: &Value,
        bytes: &[u8],
        token: &str,
        drops: &mut Drops,
    ) -> Result<(), Error> {
        match Outputs::read(value) {
            Ok(outputs) if outputs.token != token => count(drops, "unauthenticated"),
            Ok(outputs) => self.order(outputs, bytes, drops),
            Err(error) if carries(value, token) => {
                Err(self.blamed(format!("a malformed Outputs: {error}")))
            }
            Err(_) => count(drops, "malformed"),
        }
    }

    fn order(&mut self, outputs: Outputs, bytes: &[u8], drops: &mut Drops) -> Result<(), Error> {
        let (step, newest) = (outputs.step, self.newest);
        if step == -1 || step == newest + self.every {
            self.connected = true;
        }
        if step == -1 {
            return Ok(());
        }
        if step == newest + self.every {
            self.newest = step;
            self.newest_bytes = bytes.to_vec();
            self.ahead.push_back(outputs);
            return Ok(());
        }
        if step < newest {
            return count(drops, "stale");
        }
        if step == newest && bytes == self.newest_bytes {
            return count(drops, "duplicate");
        }
        let what = if step == newest { "step {} twice, with other content" } else { "step {}" };
        let what = what.replace("{}", &step.to_string());
        Err(self.blamed(format!("{what} after step {newest}; it fires every {}", self.every)))
    }

    /// Returns whether all that is due at step k is here.
    pub fn has_due(&self, k: i64) -> bool {
        self.inputs.iter().all(|input| input.due(k) <= self.newest)
    }

    /// Lets each input take over what is due at step k, and all it skipped (P6.3, P8.2).
    pub fn advance(&mut self, k: i64) -> Result<(), Error> {
        for input in &mut self.inputs {
            let (due, taken) = (input.due(k), input.taken);
            for outputs in self.ahead.iter().filter(|o| o.step > taken && o.step <= due) {
                input.take(outputs)?;
            }
        }
        let needless = self.inputs.iter().map(|input| input.taken).min().unwrap_or(-1);
        while self.ahead.front().is_some_and(|outputs| outputs.step <= needless) {
            self.ahead.pop_front();
        }
        Ok(())
    }

    /// Returns what each input holds: name, configuration, message.
    pub fn held(&self) -> impl Iterator<Item = (&str, &InputConfig, Option<&Value>)> {
        self.inputs.iter().map(|i| (i.name.as_str(), &i.config, i.held.as_ref()))
    }

    fn blamed(&self, what: String) -> Error {
        Error::Message {
            text: format!("{} published {what}", self.name),
            blames: Some(self.name.clone()),
        }
    }
}

fn carries(value: &Value, token: &str) -> bool {
    let pairs = value.as_map().map_or(&[][..], Vec::as_slice);
    pairs.iter().any(|(k, v)| k.as_str() == Some("token") && v.as_str() == Some(token))
}

/// Counts a message that is dropped.
pub fn count(drops: &mut Drops, cause: &str) -> Result<(), Error> {
    *drops.entry(cause.to_owned()).or_default() += 1;
    Ok(())
}

#[cfg(test)]
mod tests;

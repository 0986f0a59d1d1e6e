//! A participant's session in a run: what has arrived, what is to be reported.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::time::{Duration, Instant};

use crate::batch::Batch;
use crate::bus::{Bus, Event};
use crate::codec::{decode, encode};
use crate::envelopes::{Fault, Outputs, Ready, Start, Stop, Trigger, Waiting, Welcome};
use crate::error::Error;
use crate::participant::Answer;
use crate::source::{count, Drops, Source};

/// Time after which a waiting participant says so, and sends its handshake again (P4.6, P9.2.4).
const PATIENCE: Duration = Duration::from_millis(20);
/// How long the answer may take that shows that all is out (P11.4).
const DELIVERY: Duration = Duration::from_secs(10);
/// How often a longer wait checks whether the process should end.
const POLL: Duration = Duration::from_millis(100);

/// Why a participant leaves the run other than by its end.
pub enum Leave {
    /// It cannot continue, and reports a fault.
    Fault(Error),
    /// It should not continue, and no orchestrator is left to notify.
    Quit(String),
}

impl<E: Into<Error>> From<E> for Leave {
    fn from(error: E) -> Self {
        Self::Fault(error.into())
    }
}

/// What a participant that has been welcomed does in its run.
pub struct Session {
    /// What the orchestrator has sent.
    pub welcome: Welcome,
    /// Where the inputs come from.
    pub sources: Vec<Source>,
    /// The descriptions of the inputs, once all are ready.
    pub start: Option<Start>,
    /// The step it is at.
    pub step: i64,
    /// The step to end at.
    pub stop_at: i64,
    bus: Bus,
    step_limit: u64,
    published: i64,
    batch: Batch,
    drops: Drops,
    terminated: Arc<AtomicBool>,
}

impl Session {
    /// Takes part with an open bus.
    pub fn new(bus: Bus, welcome: Welcome, terminated: Arc<AtomicBool>) -> Self {
        Self {
            sources: Source::all(&welcome.inputs),
            start: None,
            step: -1,
            stop_at: i64::MAX,
            bus,
            step_limit: 0,
            published: -1,
            batch: Batch::default(),
            drops: Drops::new(),
            terminated,
            welcome,
        }
    }

    /// Subscribes to all that concerns this participant.
    pub fn subscribe(&mut self) -> Result<(), Leave> {
        Ok(self.bus.subscribe(self.sources.iter().map(|source| source.name.as_str()))?)
    }

    /// Sends handshakes until the clock starts, or the run is over before (P4.6).
    pub fn send_handshake(&mut self, ready: &Ready) -> Result<(), Leave> {
        let token = self.welcome.token.clone();
        let (ports, bulk, slots) = ([].into(), [].into(), [].into());
        let handshake = Outputs { token, step: -1, t_ns: 0, ports, bulk, slots, end: None };
        let (handshake, ready) = (encode(&handshake), encode(ready));
        self.check_size("Ready", &ready)?;
        while self.start.is_none() && self.stop_at >= 0 {
            self.bus.publish_out(handshake.clone())?;
            let deaf = self.sources.iter().filter(|source| !source.connected);
            let sources: Vec<_> = deaf.map(|source| source.name.clone()).collect();
            if sources.is_empty() {
                self.send_log(None)?;
                self.bus.publish("ready", "Ready/1", ready.clone())?;
            } else {
                self.send_log(Some(Waiting { step: -1, sources }))?;
            }
            let next = Instant::now() + PATIENCE;
            while self.start.is_none() && self.stop_at >= 0 && Instant::now() < next {
                self.take_in(next.saturating_duration_since(Instant::now()))?;
            }
        }
        Ok(())
    }

    /// Waits for the trigger of a step; returns false where the run ends before it.
    pub fn triggered(&mut self, step: i64) -> Result<bool, Leave> {
        self.step = step;
        self.wait(|session| step < session.step_limit as i64, &[])
    }

    /// Waits for the source with this index; returns false where the run ends before.
    pub fn supplied(&mut self, index: usize) -> Result<bool, Leave> {
        let (step, name) = (self.step, self.sources[index].name.clone());
        self.wait(|session| session.sources[index].has_due(step), &[name])
    }

    fn wait(
        &mut self,
        is_there: impl Fn(&Self) -> bool,
        sources: &[String],
    ) -> Result<bool, Leave> {
        let report_at = Instant::now() + PATIENCE;
        let mut reported = false;
        loop {
            if self.step >= self.stop_at {
                return Ok(false);
            }
            if is_there(self) {
                if reported {
                    // The report may have crossed what was waited for (P9.3.3).
                    self.send_log(None)?;
                }
                return Ok(true);
            }
            let left = report_at.saturating_duration_since(Instant::now());
            if left.is_zero() && !reported {
                reported = true;
                self.send_log(Some(Waiting { step: self.step, sources: sources.to_vec() }))?;
            }
            self.take_in(if reported { POLL } else { left })?;
        }
    }

    /// Takes in what arrives within the time, at most one message.
    fn take_in(&mut self, timeout: Duration) -> Result<(), Leave> {
        if self.terminated.load(Ordering::Relaxed) {
            return Err(Leave::Quit("terminated".to_owned()));
        }
        let token = &self.welcome.token;
        match self.bus.next(timeout) {
            None => {}
            Some(Event::Gone) => {
                return Err(Leave::Quit("lost the connection to the orchestrator".to_owned()))
            }
            Some(Event::Output(index, bytes)) => {
                self.sources[index].accept(&bytes, token, &mut self.drops)?;
            }
            Some(Event::Start(bytes)) => match decode::<Start>(&bytes) {
                Ok(start) if start.token == *token => drop(self.start.get_or_insert(start)),
                _ => count(&mut self.drops, "unauthenticated")?,
            },
            Some(Event::Trigger(bytes)) => match decode::<Trigger>(&bytes) {
                Ok(trigger) if trigger.token == *token => {
                    self.step_limit = self.step_limit.max(trigger.step_limit)
                }
                _ => count(&mut self.drops, "unauthenticated")?,
            },
            Some(Event::Stop(bytes)) => match decode::<Stop>(&bytes) {
                Ok(stop) if stop.token == *token => self.stop_at = stop.at_step.max(-1),
                _ => count(&mut self.drops, "unauthenticated")?,
            },
        }
        Ok(())
    }

    /// Publishes the outputs of the current step, and adds them to the log (P7, P9.1).
    pub fn publish(&mut self, answer: Answer) -> Result<(), Leave> {
        let (end, step) = (answer.end.clone(), self.step);
        let ports = answer.checked(&self.welcome.outputs)?;
        let t_ns = step * self.welcome.step_ns.get() as i64;
        let token = self.welcome.token.clone();
        let (bulk, slots) = ([].into(), [].into());
        let bytes = encode(&Outputs { token, step, t_ns, ports, bulk, slots, end });
        self.check_size("Outputs", &bytes)?;
        if self.batch.has_no_room(&bytes) {
            self.send_log(None)?;
        }
        self.batch.add(&bytes);
        self.published = step;
        Ok(self.bus.publish_out(bytes)?)
    }

    /// Returns whether the outputs of the current step are out.
    pub fn has_published(&self) -> bool {
        self.published == self.step
    }

    fn check_size(&self, what: &str, bytes: &[u8]) -> Result<(), Leave> {
        let (length, most) = (bytes.len(), self.welcome.max_outputs_bytes.get());
        if length as u64 <= most {
            return Ok(());
        }
        let name = &self.welcome.name;
        let text =
            format!("{name}: {what} has {length} bytes, the bus carries {most}; publish less");
        Err(Leave::Fault(Error::Message { text, blames: None }))
    }

    /// Notes that the current step is done.
    pub fn finish(&mut self, waited: Duration, computed: Duration) -> Result<(), Leave> {
        self.batch.finish(self.step, waited, computed);
        self.report()
    }

    /// Sends the batch if it is due.
    pub fn report(&mut self) -> Result<(), Leave> {
        if self.batch.is_due(self.welcome.batch.get()) {
            self.send_log(None)?;
        }
        Ok(())
    }

    /// Sends what is in the batch, even if that is nothing.
    pub fn send_log(&mut self, waiting: Option<Waiting>) -> Result<(), Leave> {
        let Welcome { name, token, .. } = &self.welcome;
        Ok(self.bus.publish_log(self.batch.take(name, token, &self.drops, waiting))?)
    }

    /// Reports a fault and waits a second for the stop (P10.1).
    pub fn fault(&mut self, error: &Error) -> Result<(), Leave> {
        self.send_log(None)?;
        let (traceback, blames) = match error {
            Error::Raised { traceback, .. } => (cut(traceback, 20_000), None),
            Error::Message { blames, .. } => (String::new(), blames.clone()),
            _ => (String::new(), None),
        };
        let fault = Fault {
            name: self.welcome.name.clone(),
            token: self.welcome.token.clone(),
            step: self.step,
            r#type: error.fault_type().to_owned(),
            message: cut(&error.to_string(), 2_000),
            traceback,
            blames,
        };
        self.bus.publish("fault", "Fault/1", encode(&fault))?;
        let deadline = Instant::now() + Duration::from_secs(1);
        while self.stop_at == i64::MAX && Instant::now() < deadline {
            // A second fault changes nothing any more.
            if let Err(quit @ Leave::Quit(_)) = self.take_in(PATIENCE) {
                return Err(quit);
            }
        }
        Ok(())
    }

    /// Closes the session. `hello`: is sent again before, since the answer shows that all else is
    /// out: only the low-latency transport does not drop what it has not sent yet (P11.4).
    pub fn close(self, hello: Option<Vec<u8>>) -> zenoh::Result<()> {
        if let Some(hello) = hello {
            if let Ok(mut replies) = self.bus.query_join(hello, DELIVERY) {
                replies.next();
            }
        }
        self.bus.close()
    }
}

fn cut(text: &str, most: usize) -> String {
    text.chars().take(most).collect()
}

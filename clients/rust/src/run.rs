//! From the ticket to the exit code.

use std::cell::RefCell;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::bus::Bus;
use crate::codec::{encode, unpack, Field, Fields};
use crate::envelopes::{Hello, Publishes, Ready, Refusal, Welcome};
use crate::error::Error;
use crate::participant::{Inputs, Participant, Ports};
use crate::session::{Leave, Session};
use crate::ticket::Ticket;

const PROTOCOL: i64 = 2;

/// Takes part in the run of the ticket, from joining to the exit code.
///
/// ```no_run
/// # use stepbus_client::*;
/// # struct Nothing;
/// # impl Participant for Nothing {
/// #     fn load(_: &Welcome) -> Result<Self, Error> { Ok(Nothing) }
/// #     fn describe(&self) -> std::collections::BTreeMap<String, Description> { [].into() }
/// #     fn update(&mut self, _: i64, _: &Inputs) -> Result<Answer, Error> { Ok(Answer::default()) }
/// # }
/// fn main() -> std::process::ExitCode {
///     stepbus_client::run::<Nothing>()
/// }
/// ```
pub fn run<P: Participant>() -> ExitCode {
    let ticket = match Ticket::from_environment() {
        Ok(ticket) => ticket,
        Err(text) => return print_error(&text, 2),
    };
    record_panics();
    let terminated = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&terminated);
    if let Err(error) = signal_hook::flag::register(signal_hook::consts::SIGTERM, flag) {
        return print_error(&format!("cannot handle SIGTERM: {error}"), 1);
    }
    match Bus::open(&ticket) {
        Ok(bus) => take_part::<P>(bus, &ticket, terminated),
        Err(error) => print_error(&format!("cannot open the bus: {error}"), 1),
    }
}

fn print_error(text: &str, code: u8) -> ExitCode {
    eprintln!("stepbus-client: {text}");
    ExitCode::from(code)
}

fn take_part<P: Participant>(bus: Bus, ticket: &Ticket, terminated: Arc<AtomicBool>) -> ExitCode {
    let joined = join(&bus, ticket, &hello::<P>(ticket), &terminated);
    let (closed, outcome) = match joined {
        Ok(welcome) => {
            let mut session = Session::new(bus, welcome, terminated);
            let outcome = live::<P>(&mut session).or_else(|leave| part(&mut session, leave));
            let is_slow = outcome.is_ok() && !ticket.endpoint.low_latency;
            (session.close(is_slow.then(|| encode(&hello::<P>(ticket)))), outcome)
        }
        Err(text) => (bus.close(), Err(text)),
    };
    match outcome.and_then(|()| closed.map_err(|error| error.to_string())) {
        Ok(()) => ExitCode::SUCCESS,
        Err(text) => print_error(&text, 1),
    }
}

/// Reports to the run why the participant leaves, as far as it can; returns the sentence.
fn part(session: &mut Session, leave: Leave) -> Result<(), String> {
    let (sent, text) = match &leave {
        Leave::Fault(error) => (session.fault(error), error.to_string()),
        Leave::Quit(text) => (session.send_log(None), text.clone()),
    };
    match sent {
        Ok(()) => Err(text),
        Err(Leave::Quit(also) | Leave::Fault(Error::Bus(also))) => Err(format!("{text}; {also}")),
        Err(Leave::Fault(also)) => Err(format!("{text}; {also}")),
    }
}

fn hello<P: Participant>(ticket: &Ticket) -> Hello {
    let pair = |(port, of): &(&str, &str)| (port.to_string(), of.to_string());
    let ports = |known: Ports| known.map(|ports| ports.iter().map(pair).collect());
    Hello {
        protocol: PROTOCOL,
        name: ticket.name.clone(),
        token: ticket.token.clone(),
        pid: i64::from(std::process::id()),
        language: "rust".to_owned(),
        sdk: concat!("stepbus-client ", env!("CARGO_PKG_VERSION")).to_owned(),
        inputs: ports(P::INPUTS),
        outputs: ports(P::OUTPUTS),
        types: P::TYPES.iter().map(|declare| declare()).collect(),
        batches: true,
        lowest_protocol: None,
    }
}

/// Asks until it is answered: the first valid `Welcome` counts, another reply only where there is
/// none (P4.2). Else says why not.
fn join(bus: &Bus, ticket: &Ticket, hello: &Hello, quit: &AtomicBool) -> Result<Welcome, String> {
    let (hello, timeout) = (encode(hello), ticket.join_timeout());
    let deadline = Instant::now() + timeout;
    while !quit.load(Ordering::Relaxed) {
        let replies = bus.query_join(hello.clone(), timeout).map_err(|error| error.to_string())?;
        let mut refusal = None;
        for reply in replies {
            match read_reply(&reply, ticket) {
                Ok(welcome) => return Ok(welcome),
                Err(text) => refusal = refusal.or(Some(text)),
            }
        }
        if let Some(text) = refusal {
            return Err(text);
        }
        if Instant::now() > deadline {
            return Err(format!("no answer from the orchestrator for {timeout:?}; is it running?"));
        }
        sleep(Duration::from_millis(50));
    }
    Err("terminated".to_owned())
}

fn read_reply(bytes: &[u8], ticket: &Ticket) -> Result<Welcome, String> {
    let strange = |error| format!("the orchestrator's answer is malformed: {error}");
    let value = unpack(bytes).map_err(strange)?;
    let refused = Fields::of(&value).and_then(|fields| fields.get::<crate::Value>("reason", None));
    if refused.is_ok() {
        return Err(Refusal::read(&value).map_err(strange)?.reason);
    }
    let welcome = Welcome::read(&value).map_err(strange)?;
    if welcome.protocol != PROTOCOL {
        return Err(format!(
            "the orchestrator speaks protocol {}, this program {PROTOCOL}",
            welcome.protocol
        ));
    }
    if welcome.name != ticket.name || welcome.token != ticket.token {
        return Err(format!("the answer is for {} of another run", welcome.name));
    }
    Ok(welcome)
}

/// From the welcome to the last log.
fn live<P: Participant>(session: &mut Session) -> Result<(), Leave> {
    session.subscribe()?;
    refuse_bulk(&session.welcome)?;
    let mut model = guard(|| P::load(&session.welcome))?;
    let outputs = guard(|| Ok(model.describe()))?;
    let Welcome { name, token, .. } = session.welcome.clone();
    session.send_handshake(&Ready {
        name: name.clone(),
        token,
        outputs,
        versions: [].into(),
        calls: [].into(),
        slots: [].into(),
    })?;
    if let Some(start) = session.start.take() {
        let inputs = start.inputs.get(&name).cloned().unwrap_or_default();
        guard(|| model.start(&inputs))?;
        do_steps(session, &mut model)?;
    }
    session.send_log(None)
}

fn refuse_bulk(welcome: &Welcome) -> Result<(), Error> {
    let inputs = welcome.inputs.iter().filter(|(_, config)| config.bulk).map(|(port, _)| port);
    let outputs = welcome.outputs.iter().filter(|(_, config)| config.bulk).map(|(port, _)| port);
    match inputs.chain(outputs).next() {
        None => Ok(()),
        Some(port) => Err(Error::Wiring(format!(
            "{}: {port} is a bulk port, which stepbus-client does not carry; use Python for it",
            welcome.name
        ))),
    }
}

fn do_steps<P: Participant>(session: &mut Session, model: &mut P) -> Result<(), Leave> {
    let first = session.welcome.publishes == Publishes::First;
    let every = session.welcome.every.get() as i64;
    let mut step = 0;
    while do_step(session, model, step)? {
        step += every;
    }
    if first && session.step == session.stop_at && !session.has_published() {
        let answer = guard(|| model.state(step))?;
        session.publish(answer)?;
    }
    Ok(())
}

/// Does one step; returns false where the run ends before it.
fn do_step<P: Participant>(session: &mut Session, model: &mut P, step: i64) -> Result<bool, Leave> {
    let first = session.welcome.publishes == Publishes::First;
    let begun = Instant::now();
    if !session.triggered(step)? {
        return Ok(false);
    }
    let mut waited = begun.elapsed();
    if first {
        let answer = guard(|| model.state(step))?;
        session.publish(answer)?;
        session.report()?;
    }
    let published = Instant::now();
    for index in 0..session.sources.len() {
        if !session.supplied(index)? {
            return Ok(false);
        }
    }
    waited += published.elapsed();
    for source in &mut session.sources {
        source.advance(step)?;
    }
    let answer = guard(|| model.update(step, &Inputs(&session.sources)))?;
    if !first {
        session.publish(answer)?;
    }
    session.finish(waited, begun.elapsed().saturating_sub(waited))?;
    Ok(true)
}

thread_local! {
    static LAST_PANIC: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Keeps where a panic happened, for the fault; it is still printed.
fn record_panics() {
    let print = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        let trace = std::backtrace::Backtrace::force_capture();
        LAST_PANIC.with_borrow_mut(|last| *last = format!("{info}\n{trace}"));
        print(info);
    }));
}

/// Calls the participant; a panic of it becomes an error.
fn guard<T>(call: impl FnOnce() -> Result<T, Error>) -> Result<T, Error> {
    catch_unwind(AssertUnwindSafe(call)).unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().cloned();
        let text = text.or_else(|| panic.downcast_ref::<&str>().map(|text| text.to_string()));
        Err(Error::Raised {
            text: format!("panicked: {}", text.unwrap_or_else(|| "without a text".to_owned())),
            traceback: LAST_PANIC.take(),
        })
    })
}

#[cfg(test)]
mod tests {
    use super::{guard, record_panics, Error};

    #[test]
    fn a_panic_becomes_an_error_that_says_where() {
        record_panics();
        let error = guard::<()>(|| panic!("no joint {}", "elbow")).unwrap_err();
        let Error::Raised { text, traceback } = error else { panic!("{error:?}") };
        assert_eq!(text, "panicked: no joint elbow");
        assert!(traceback.contains("run.rs"));
    }
}

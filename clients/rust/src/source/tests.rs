//! The tables of clauses P6.1 and P8.1.

use std::collections::BTreeMap;

use super::{Drops, Source};
use crate::codec::{self, encode, pack, Field, Value};
use crate::envelopes::{Batch, InputConfig, Outputs};
use crate::error::Error;

const TOKEN: &str = "00c0ffee00c0ffee";

fn source(delay: u64, every: u64) -> Source {
    let fields = [("source", "plant".into()), ("port", "x".into()), ("type", "X/1".into())];
    let numbers = [("delay", delay.into()), ("every", every.into())];
    let pairs =
        fields.into_iter().chain(numbers).map(|(key, value): (_, Value)| (key.into(), value));
    let config = InputConfig::read(&Value::Map(pairs.collect())).unwrap();
    Source::all(&BTreeMap::from([("input".to_owned(), config)])).remove(0)
}

fn outputs(step: i64, ports: &[(&str, Value)]) -> Vec<u8> {
    let ports = ports.iter().map(|(port, value)| (port.to_string(), value.clone())).collect();
    encode(&Outputs {
        token: TOKEN.to_owned(),
        step,
        t_ns: step,
        ports,
        bulk: [].into(),
        slots: [].into(),
        end: None,
    })
}

fn number(n: i64) -> Value {
    Value::Map(vec![("n".into(), n.into())])
}

fn held(source: &Source) -> Option<i64> {
    let value = source.held().next().unwrap().2?;
    value["n"].as_i64()
}

/// Publishes steps 0 to 6 and returns what the input holds at each.
fn table(delay: u64, every: u64) -> String {
    let mut source = source(delay, every);
    for step in (0..7).filter(|step| step % every as i64 == 0) {
        source.accept(&outputs(step, &[("x", number(step))]), TOKEN, &mut Drops::new()).unwrap();
    }
    let row = (0..7).map(|step| {
        source.advance(step).unwrap();
        held(&source).map_or("none".to_owned(), |n| n.to_string())
    });
    row.collect::<Vec<_>>().join(" ")
}

#[test]
fn an_input_takes_what_is_due_and_nothing_later() {
    assert_eq!(table(0, 1), "0 1 2 3 4 5 6");
    assert_eq!(table(1, 1), "none 0 1 2 3 4 5");
    assert_eq!(table(0, 4), "0 0 0 0 4 4 4");
    assert_eq!(table(1, 4), "none 0 0 0 0 4 4");
}

#[test]
fn a_port_that_is_left_out_is_held() {
    let mut source = source(0, 1);
    for (step, ports) in [(0, vec![("x", number(7))]), (1, vec![])] {
        source.accept(&outputs(step, &ports), TOKEN, &mut Drops::new()).unwrap();
    }
    source.advance(1).unwrap();
    assert_eq!(held(&source), Some(7));
}

#[test]
fn what_is_unauthenticated_malformed_duplicate_or_stale_is_dropped_and_counted() {
    let (mut source, mut drops) = (source(0, 1), Drops::new());
    for step in [-1, 0, 1, 1, 0] {
        source.accept(&outputs(step, &[]), TOKEN, &mut drops).unwrap();
    }
    source.accept(&outputs(2, &[]), "another", &mut drops).unwrap();
    source.accept(b"\xc1", TOKEN, &mut drops).unwrap();
    source.accept(&pack(&number(1)), TOKEN, &mut drops).unwrap();
    let counts: Vec<_> = drops.iter().map(|(cause, n)| format!("{cause} {n}")).collect();
    assert_eq!(counts.join(", "), "duplicate 1, malformed 2, stale 1, unauthenticated 1");
}

#[test]
fn the_entries_of_a_batch_count_as_messages_of_their_own() {
    let entry = |step| codec::unpack(&outputs(step, &[("x", number(step))])).unwrap();
    let batch = |token: &str, steps: &[i64]| {
        let entries = steps.iter().map(|step| entry(*step)).collect();
        encode(&Batch { token: token.to_owned(), outputs: entries })
    };
    let (mut source, mut drops) = (source(0, 1), Drops::new());
    source.accept(&batch("another", &[0]), TOKEN, &mut drops).unwrap();
    source.accept(&batch(TOKEN, &[0, 1, 2, 2]), TOKEN, &mut drops).unwrap();
    source.advance(1).unwrap();
    assert_eq!(held(&source), Some(1));
    source.advance(2).unwrap();
    assert_eq!(held(&source), Some(2));
    let counts: Vec<_> = drops.iter().map(|(cause, n)| format!("{cause} {n}")).collect();
    assert_eq!(counts.join(", "), "duplicate 1, unauthenticated 1");
    assert!(source.accept(&batch(TOKEN, &[3, 5]), TOKEN, &mut drops).is_err());
}

#[test]
fn a_source_is_blamed_for_what_it_cannot_mean() {
    let token_alone = pack(&Value::Map(vec![("token".into(), TOKEN.into())]));
    let wrong = [outputs(0, &[("x", number(1))]), outputs(2, &[]), outputs(-2, &[]), token_alone];
    let blamed = wrong.iter().map(|bytes| {
        let (mut source, mut drops) = (source(0, 1), Drops::new());
        source.accept(&outputs(0, &[]), TOKEN, &mut drops).unwrap();
        matches!(
            source.accept(bytes, TOKEN, &mut drops),
            Err(Error::Message { blames: Some(_), .. })
        )
    });
    assert_eq!(blamed.collect::<Vec<_>>(), [true, true, false, true]);
}

#[test]
fn a_message_is_read_only_when_it_is_due() {
    let (mut source, mut drops) = (source(1, 1), Drops::new());
    source.accept(&outputs(0, &[("x", 5.into()), ("y", 5.into())]), TOKEN, &mut drops).unwrap();
    assert!(source.advance(0).is_ok());
    assert!(source.advance(1).unwrap_err().to_string().contains("plant published a malformed x"));
}

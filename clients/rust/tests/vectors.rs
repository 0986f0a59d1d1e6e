//! The byte vectors of stepbus, `schemas/vectors.json`.

use serde_json::Value as Json;
use stepbus_client::codec::{decode, encode, Message};
use stepbus_client::envelopes::*;
use stepbus_client::{ControllerStatus, JointCommand, JointReference, JointState, Value};

fn vectors() -> Json {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../schemas/vectors.json");
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn bytes(case: &Json) -> Vec<u8> {
    let hex = case["hex"].as_str().unwrap();
    let pair = |i| u8::from_str_radix(&hex[i..i + 2], 16).unwrap();
    (0..hex.len()).step_by(2).map(pair).collect()
}

/// Reads a value as the notation of the file says.
fn value(json: &Json) -> Value {
    if let Some(text) = json.get("$float").and_then(Json::as_str) {
        return Value::F64(text.parse().unwrap());
    }
    if let Some(text) = json.get("$int").and_then(Json::as_str) {
        return text
            .parse::<u64>()
            .map_or_else(|_| text.parse::<i64>().unwrap().into(), Value::from);
    }
    if let Some(hex) = json.get("$bin").and_then(Json::as_str) {
        let pair = |i| u8::from_str_radix(&hex[i..i + 2], 16).unwrap();
        return Value::Binary((0..hex.len()).step_by(2).map(pair).collect());
    }
    match json {
        Json::Null => Value::Nil,
        Json::Bool(flag) => (*flag).into(),
        Json::String(text) => text.as_str().into(),
        Json::Number(number) if number.is_f64() => Value::F64(number.as_f64().unwrap()),
        Json::Number(number) => {
            number.as_i64().map_or_else(|| number.as_u64().unwrap().into(), Value::from)
        }
        Json::Array(items) => Value::Array(items.iter().map(value).collect()),
        Json::Object(map) => {
            Value::Map(map.iter().map(|(key, item)| (key.as_str().into(), value(item))).collect())
        }
    }
}

/// Returns whether two values mean the same, whatever the order of keys.
///
/// serde_json reads some floats one unit of the last digit off: the bytes decide on those.
fn same(one: &Value, other: &Value) -> bool {
    match (one, other) {
        (Value::F64(x), Value::F64(y)) => {
            x == y || (x - y).abs() <= 4e-16 * x.abs() || (x.is_nan() && y.is_nan())
        }
        (Value::Array(x), Value::Array(y)) => {
            x.len() == y.len() && x.iter().zip(y).all(|(x, y)| same(x, y))
        }
        (Value::Map(x), Value::Map(y)) => {
            let has = |key, x| y.iter().any(|(other, y)| other == key && same(x, y));
            x.len() == y.len() && x.iter().all(|(key, x)| has(key, x))
        }
        _ => one == other,
    }
}

/// Goes through all vectors of a type; returns how many there were.
fn check<T: Message>() -> usize {
    let all = vectors();
    let of_type = &all["types"][T::TYPE];
    let cases = |group: &str| of_type[group].as_array().unwrap().clone();
    for case in [cases("exact"), cases("accepted")].concat() {
        let read = decode::<T>(&bytes(&case));
        let read = read.unwrap_or_else(|error| panic!("{} {}: {error}", T::TYPE, case["name"]));
        let meant = T::read(&value(&case["value"])).unwrap();
        assert!(same(&read.write(), &meant.write()), "{} {}", T::TYPE, case["name"]);
    }
    for case in cases("refused") {
        assert!(decode::<T>(&bytes(&case)).is_err(), "{} {}", T::TYPE, case["name"]);
    }
    cases("exact").len() + cases("accepted").len() + cases("refused").len()
}

#[test]
fn every_vector_of_a_port_message_is_read_or_refused() {
    let counts = [
        check::<JointState>(),
        check::<JointReference>(),
        check::<JointCommand>(),
        check::<ControllerStatus>(),
    ];
    assert!(counts.iter().all(|count| *count > 20), "{counts:?}");
}

#[test]
fn every_vector_of_an_envelope_is_read_or_refused() {
    let counts = [
        check::<Hello>(),
        check::<Welcome>(),
        check::<Refusal>(),
        check::<Ready>(),
        check::<Start>(),
        check::<Trigger>(),
        check::<Stop>(),
        check::<Outputs>(),
        check::<Fault>(),
        check::<Batch>(),
    ];
    assert!(counts.iter().all(|count| *count > 10), "{counts:?}");
}

/// Checks that the messages of a type are written as in the vectors.
fn check_bytes<T: Message>() {
    for case in vectors()["types"][T::TYPE]["exact"].as_array().unwrap() {
        let written = encode(&decode::<T>(&bytes(case)).unwrap());
        assert_eq!(written, bytes(case), "{} {}", T::TYPE, case["name"]);
    }
}

#[test]
fn a_port_message_has_exactly_the_bytes_of_the_vectors() {
    check_bytes::<JointState>();
    check_bytes::<JointReference>();
    check_bytes::<JointCommand>();
    check_bytes::<ControllerStatus>();
}

#[test]
fn malformed_data_is_reported_with_its_path() {
    let error = decode::<JointReference>(&[
        0x81, 0xa8, b'p', b'o', b's', b'i', b't', b'i', b'o', b'n', 0x91, 0xc3,
    ]);
    assert_eq!(error.unwrap_err().to_string(), "expected a number at `$.position[0]`");
}

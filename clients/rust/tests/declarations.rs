//! What a program declares of types of its own, as `Hello` carries it (P14.5).

use stepbus_client::codec::{decode, encode};
use stepbus_client::envelopes::Hello;
use stepbus_client::{declared, message, Value};

message! {
    /// Fields of every form.
    "Probe/1",
    struct Probe {
        /// Vector with a unit.
        thrust: Vec<f64> as "float[n]" in "N",
        /// One of some words.
        mode: String as "off | on",
        /// May be absent.
        depth: Option<f64> as "float" in "m",
        /// Has a default.
        count: i64 as "int" = 3,
    }
}

message! {
    /// Without forms it declares nothing.
    "Bare/1",
    struct Bare {
        /// No form.
        depth: f64,
    }
}

fn map(pairs: &[(&str, Value)]) -> Value {
    Value::Map(pairs.iter().map(|(key, value)| ((*key).into(), value.clone())).collect())
}

#[test]
fn a_type_is_declared_as_a_scenario_declares_it() {
    let (name, rows) = declared::<Probe>();
    let words = Value::Array(vec!["off".into(), "on".into()]);
    assert_eq!(name, "Probe/1");
    assert_eq!(rows["thrust"], map(&[("type", "float[n]".into()), ("unit", "N".into())]));
    assert_eq!(rows["mode"], map(&[("type", words)]));
    let depth = [("type", "float".into()), ("unit", "m".into()), ("optional", true.into())];
    assert_eq!(rows["depth"], map(&depth));
    assert_eq!(rows["count"], map(&[("type", "int".into()), ("default", 3.into())]));
    assert_eq!(rows.len(), 4);
}

#[test]
#[should_panic(expected = "Bare/1: give each field its form")]
fn a_type_without_forms_cannot_be_declared() {
    declared::<Bare>();
}

#[test]
fn hello_carries_the_declarations() {
    let hello = Hello {
        protocol: 2,
        name: "probe".to_owned(),
        token: "0".to_owned(),
        pid: 1,
        language: "rust".to_owned(),
        sdk: String::new(),
        inputs: None,
        outputs: None,
        types: [declared::<Probe>()].into(),
        batches: true,
        lowest_protocol: None,
    };
    let again: Hello = decode(&encode(&hello)).unwrap();
    assert_eq!(again.types["Probe/1"]["thrust"], declared::<Probe>().1["thrust"]);
}

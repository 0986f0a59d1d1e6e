//! MessagePack with the strictness of clause P3.4: malformed data is reported with its path.

use std::collections::BTreeMap;
use std::fmt;
use std::num::NonZeroU64;

pub use rmpv::Value;
use serde::Deserialize;

/// A message that does not match its type, or invalid MessagePack.
#[derive(Clone, Debug, PartialEq)]
pub struct Malformed {
    path: String,
    expected: String,
}

impl Malformed {
    /// Says that the value itself is wrong; callers prepend where it is with `within`.
    pub fn new(expected: impl Into<String>) -> Self {
        let path = String::new();
        let expected = expected.into();
        Self { path, expected }
    }

    /// Prepends a step of the path, `.field` or `[index]`.
    pub fn within(mut self, part: &str) -> Self {
        self.path.insert_str(0, part);
        self
    }
}

impl fmt::Display for Malformed {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "expected {} at `${}`", self.expected, self.path)
    }
}

/// A value that a field can hold.
pub trait Field: Sized {
    /// Reads the value, or returns what is wrong with it.
    fn read(value: &Value) -> Result<Self, Malformed>;

    /// Makes the MessagePack value.
    fn write(&self) -> Value;

    /// What an absent field without a default stands for; none: it is required.
    fn absent() -> Option<Self> {
        None
    }
}

/// A message type, `Name/major`. Made by the macro `message!`.
pub trait Message: Field {
    /// Name and major version, as in the scenario: `JointState/1`.
    const TYPE: &'static str;

    /// Declares the type as a scenario does; none unless each field says its form.
    fn declaration() -> Option<Declaration> {
        None
    }
}

/// A message type as a scenario declares it: field → its row.
pub type Declaration = BTreeMap<String, Value>;

/// Returns a program's own message type with its declaration, for `Participant::TYPES`.
///
/// Panics where a field lacks its form.
pub fn declared<T: Message>() -> (String, Declaration) {
    let rows = T::declaration();
    let rows =
        rows.unwrap_or_else(|| panic!("{}: give each field its form: `as \"float\"`", T::TYPE));
    (T::TYPE.to_owned(), rows)
}

/// Returns the row of a field; none without a form, of which `|` separates words.
#[doc(hidden)]
pub fn row<T: Field>(form: Option<&str>, unit: Option<&str>, default: Option<T>) -> Option<Value> {
    let words: Vec<&str> = form?.split('|').map(str::trim).collect();
    let form = match words.len() {
        1 => Value::from(words[0]),
        _ => Value::Array(words.into_iter().map(Value::from).collect()),
    };
    let mut pairs = vec![("type".into(), form)];
    pairs.extend(unit.map(|unit| ("unit".into(), unit.into())));
    match default {
        Some(value) => pairs.push(("default".into(), value.write())),
        None if T::absent().is_some() => pairs.push(("optional".into(), true.into())),
        None => {}
    }
    Some(Value::Map(pairs))
}

/// Reads a payload: one value, and nothing behind it.
pub fn unpack(mut bytes: &[u8]) -> Result<Value, Malformed> {
    // Not `rmpv::decode`, which takes the reserved byte 0xc1 for nil.
    let mut reader = rmp_serde::Deserializer::new(&mut bytes);
    let value = Value::deserialize(&mut reader)
        .map_err(|error| Malformed::new(format!("MessagePack ({error})")))?;
    match bytes.len() {
        0 => Ok(value),
        n => Err(Malformed::new(format!("nothing behind the map, not {n} bytes"))),
    }
}

/// Reads a payload as one message.
pub fn decode<T: Field>(bytes: &[u8]) -> Result<T, Malformed> {
    T::read(&unpack(bytes)?)
}

/// Makes the payload of a message.
pub fn encode<T: Field>(message: &T) -> Vec<u8> {
    pack(&message.write())
}

/// Makes the bytes of a value.
pub fn pack(value: &Value) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(256);
    rmpv::encode::write_value(&mut bytes, value).expect("a vector takes any bytes");
    bytes
}

/// The fields of a map, by name.
pub struct Fields<'a>(Vec<(&'a str, &'a Value)>);

impl<'a> Fields<'a> {
    /// Looks into a map, whose keys have to be strings.
    pub fn of(value: &'a Value) -> Result<Self, Malformed> {
        let pairs = value.as_map().ok_or_else(|| Malformed::new("a map"))?;
        let key = |key: &'a Value| key.as_str().ok_or_else(|| Malformed::new("strings for keys"));
        let fields = pairs.iter().map(|(k, v)| Ok((key(k)?, v)));
        Ok(Self(fields.collect::<Result<_, _>>()?))
    }

    /// Reads a field; an absent one has its default.
    pub fn get<T: Field>(&self, name: &str, default: Option<T>) -> Result<T, Malformed> {
        match self.0.iter().find(|(key, _)| *key == name) {
            Some((_, value)) => T::read(value).map_err(|m| m.within(&format!(".{name}"))),
            None => default
                .or_else(T::absent)
                .ok_or_else(|| Malformed::new(format!("a field `{name}`"))),
        }
    }
}

macro_rules! scalar {
    ($type:ty, $expected:literal, $read:expr, $write:expr) => {
        impl Field for $type {
            fn read(value: &Value) -> Result<Self, Malformed> {
                $read(value).ok_or_else(|| Malformed::new($expected))
            }

            fn write(&self) -> Value {
                $write(self.clone())
            }
        }
    };
}

scalar!(bool, "a boolean", Value::as_bool, Value::from);
scalar!(i64, "an integer", Value::as_i64, Value::from);
scalar!(u64, "an integer from 0", Value::as_u64, Value::from);
scalar!(f64, "a number", Value::as_f64, Value::from);
scalar!(String, "a string in UTF-8", text, Value::from);
scalar!(Value, "a value", |value: &Value| Some(value.clone()), Value::from);
scalar!(
    NonZeroU64,
    "an integer from 1",
    |value: &Value| value.as_u64().and_then(NonZeroU64::new),
    |number: NonZeroU64| Value::from(number.get())
);

/// Returns a MessagePack string; `Value::as_str` is none where it is no UTF-8, or binary.
fn text(value: &Value) -> Option<String> {
    value.as_str().map(str::to_owned)
}

impl<T: Field> Field for Option<T> {
    fn read(value: &Value) -> Result<Self, Malformed> {
        (!value.is_nil()).then(|| T::read(value)).transpose()
    }

    fn write(&self) -> Value {
        self.as_ref().map_or(Value::Nil, T::write)
    }

    fn absent() -> Option<Self> {
        Some(None)
    }
}

impl<T: Field> Field for Vec<T> {
    fn read(value: &Value) -> Result<Self, Malformed> {
        let items = value.as_array().ok_or_else(|| Malformed::new("a list"))?;
        let read = |(i, item)| T::read(item).map_err(|m| m.within(&format!("[{i}]")));
        items.iter().enumerate().map(read).collect()
    }

    fn write(&self) -> Value {
        Value::Array(self.iter().map(T::write).collect())
    }
}

impl<T: Field> Field for BTreeMap<String, T> {
    fn read(value: &Value) -> Result<Self, Malformed> {
        let read = |(key, value): &(&str, &Value)| {
            let item = T::read(value).map_err(|m| m.within(&format!("[{key:?}]")))?;
            Ok((key.to_string(), item))
        };
        Fields::of(value)?.0.iter().map(read).collect()
    }

    fn write(&self) -> Value {
        Value::Map(self.iter().map(|(key, item)| (key.as_str().into(), item.write())).collect())
    }
}

/// Declares a map with its fields: `message! { "Trigger/1", struct Trigger { step_limit: u64 } }`.
///
/// `= default` after a field gives its default. Fields that hold it are left out when writing.
/// `as "float[n]" in "N"` is the form and unit of a field of your own type, as the scenario
/// declares them (`as "off | on"`: words); with them, `Participant::TYPES` may name the type.
#[macro_export]
macro_rules! message {
    ($(#[$about:meta])* $type:literal, struct $name:ident {
        $($(#[$doc:meta])* $field:ident: $of:ty
            $(as $form:literal $(in $unit:literal)?)? $(= $default:expr)?),* $(,)?
    }) => {
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq)]
        pub struct $name { $($(#[$doc])* pub $field: $of),* }

        impl $crate::codec::Field for $name {
            fn read(value: &$crate::codec::Value) -> Result<Self, $crate::codec::Malformed> {
                let fields = $crate::codec::Fields::of(value)?;
                Ok(Self {
                    $($field: fields.get(stringify!($field).trim_start_matches("r#"),
                                         [$($default)?].into_iter().next())?),*
                })
            }

            fn write(&self) -> $crate::codec::Value {
                let mut pairs = Vec::new();
                $(
                    let default: Option<$of> = [$($default)?].into_iter().next();
                    let default = default.or_else(<$of as $crate::codec::Field>::absent);
                    if default.as_ref() != Some(&self.$field) {
                        let name = stringify!($field).trim_start_matches("r#");
                        pairs.push((name.into(), $crate::codec::Field::write(&self.$field)));
                    }
                )*
                $crate::codec::Value::Map(pairs)
            }
        }

        impl $crate::codec::Message for $name {
            const TYPE: &'static str = $type;

            fn declaration() -> Option<$crate::codec::Declaration> {
                let mut rows = $crate::codec::Declaration::new();
                $(
                    let form: Option<&str> = [$($form)?].into_iter().next();
                    let unit: Option<&str> = [$($($unit)?)?].into_iter().next();
                    let default: Option<$of> = [$($default)?].into_iter().next();
                    let name = stringify!($field).trim_start_matches("r#");
                    rows.insert(name.to_owned(), $crate::codec::row(form, unit, default)?);
                )*
                Some(rows)
            }
        }
    };
}

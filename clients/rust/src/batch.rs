//! The log batch: what has been published and is not yet reported (clause P9).

use std::time::Duration;

use crate::codec::{pack, Field, Value};
use crate::envelopes::Waiting;
use crate::source::Drops;

const MOST_BYTES: usize = 30_000;
const MOST_TIME: Duration = Duration::from_millis(50);

/// `Outputs` in their bytes, and how long the steps took.
#[derive(Default)]
pub struct Batch {
    outputs: Vec<u8>,
    count: u32,
    timing: Vec<Value>,
    time: Duration,
}

impl Batch {
    /// Returns whether an entry would make the batch too large (P9.2.3).
    pub fn has_no_room(&self, entry: &[u8]) -> bool {
        self.count > 0 && self.outputs.len() + entry.len() > MOST_BYTES
    }

    /// Adds a published `Outputs`.
    pub fn add(&mut self, entry: &[u8]) {
        self.outputs.extend_from_slice(entry);
        self.count += 1;
    }

    /// Notes a finished step.
    pub fn finish(&mut self, step: i64, waited: Duration, computed: Duration) {
        let nanoseconds = |time: Duration| Value::from(time.as_nanos() as u64);
        let row = vec![Value::from(step), nanoseconds(waited), nanoseconds(computed)];
        self.timing.push(Value::Array(row));
        self.time += waited + computed;
    }

    /// Returns whether it is to be sent when a step is finished (P9.2.1, P9.2.2).
    pub fn is_due(&self, batch: u64) -> bool {
        u64::from(self.count) >= batch || self.time > MOST_TIME
    }

    /// Makes a `Log` of what is in the batch, and empties it.
    pub fn take(
        &mut self,
        name: &str,
        token: &str,
        drops: &Drops,
        waiting: Option<Waiting>,
    ) -> Vec<u8> {
        let batch = std::mem::take(self);
        let mut fields = vec![("name", pack(&name.into())), ("token", pack(&token.into()))];
        if batch.count > 0 {
            let mut list = Vec::with_capacity(batch.outputs.len() + 5);
            write_list_head(&mut list, batch.count);
            list.extend_from_slice(&batch.outputs);
            fields.push(("outputs", list));
        }
        if !batch.timing.is_empty() {
            fields.push(("timing", pack(&Value::Array(batch.timing))));
        }
        if let Some(waiting) = waiting {
            fields.push(("waiting", pack(&waiting.write())));
        }
        if !drops.is_empty() {
            fields.push(("drops", pack(&drops.write())));
        }
        // A map of up to 15 fields: its head is one byte.
        let mut bytes = vec![0x80 | fields.len() as u8];
        for (field, value) in fields {
            bytes.extend(pack(&field.into()));
            bytes.extend(value);
        }
        bytes
    }
}

/// Writes the head of a list, whose items are written already.
fn write_list_head(bytes: &mut Vec<u8>, count: u32) {
    match u16::try_from(count) {
        Ok(count) if count < 16 => bytes.push(0x90 | count as u8),
        Ok(count) => {
            bytes.push(0xdc);
            bytes.extend(count.to_be_bytes());
        }
        Err(_) => {
            bytes.push(0xdd);
            bytes.extend(count.to_be_bytes());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::unpack;

    fn sent(batch: &mut Batch) -> Value {
        unpack(&batch.take("controller", "t", &Drops::new(), None)).unwrap()
    }

    #[test]
    fn the_entries_are_nested_as_maps_in_their_order() {
        let entry = pack(&Value::Map(vec![("step".into(), 7.into())]));
        for count in [1, 15, 16, 70_000] {
            let mut batch = Batch::default();
            (0..count).for_each(|_| batch.add(&entry));
            let outputs = sent(&mut batch)["outputs"].as_array().unwrap().clone();
            assert_eq!(outputs.len(), count);
            assert!(outputs.iter().all(|entry| entry["step"] == 7.into()));
        }
    }

    #[test]
    fn an_empty_log_has_the_bytes_of_the_worked_example() {
        let token = "00c0ffee00c0ffee";
        let bytes = Batch::default().take("controller", token, &Drops::new(), None);
        let start = b"\x82\xa4name\xaacontroller\xa5token\xb000c0";
        assert_eq!((bytes.len(), &bytes[..start.len()]), (40, &start[..]));
    }

    #[test]
    fn a_batch_is_due_when_full_or_old() {
        let mut batch = Batch::default();
        batch.add(b"\x80");
        assert!(batch.is_due(1) && !batch.is_due(2));
        batch.finish(0, Duration::from_millis(30), Duration::from_millis(21));
        assert!(batch.is_due(2));
    }

    #[test]
    fn an_entry_that_makes_the_batch_too_large_has_no_room() {
        let mut batch = Batch::default();
        assert!(!batch.has_no_room(&[0; 40_000]));
        batch.add(&[0; 20_000]);
        assert!(!batch.has_no_room(&[0; 10_000]) && batch.has_no_room(&[0; 10_001]));
    }
}

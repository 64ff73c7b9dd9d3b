//! Messages of ROS 2 in CDR, little-endian (OMG DDS-XTYPES 1.1, 7.4.1): numbers are at multiples of their
//! size, counted from the end of the encapsulation; texts and lists begin with their length.

use gs2e_event::mcap::ENCAPSULATION;

/// A message that is being written.
#[derive(Debug)]
pub(super) struct CdrWriter {
    bytes: Vec<u8>,
}

impl CdrWriter {
    pub(super) fn new() -> Self {
        Self { bytes: ENCAPSULATION.to_vec() }
    }

    /// A number, at a multiple of its size.
    fn number<const N: usize>(&mut self, number: [u8; N]) {
        let at = self.bytes.len() - ENCAPSULATION.len();
        self.bytes.resize(ENCAPSULATION.len() + at.next_multiple_of(N), 0);
        self.bytes.extend(number);
    }

    pub(super) fn u8(&mut self, value: u8) {
        self.number([value]);
    }

    pub(super) fn i32(&mut self, value: i32) {
        self.number(value.to_le_bytes());
    }

    pub(super) fn u32(&mut self, value: u32) {
        self.number(value.to_le_bytes());
    }

    pub(super) fn u64(&mut self, value: u64) {
        self.number(value.to_le_bytes());
    }

    /// Numbers of a list with a fixed length.
    pub(super) fn f64s(&mut self, values: &[f64]) {
        values.iter().for_each(|value| self.number(value.to_le_bytes()));
    }

    /// The length of a list.
    ///
    /// # Panics
    /// It exceeds 32 bits.
    pub(super) fn length(&mut self, length: usize) {
        self.u32(u32::try_from(length).expect("messages are smaller than 4 GiB"));
    }

    /// A text; a zero ends it.
    pub(super) fn text(&mut self, text: &str) {
        self.length(text.len() + 1);
        self.bytes.extend(text.as_bytes());
        self.bytes.push(0);
    }

    /// A list of bytes.
    pub(super) fn list(&mut self, bytes: &[u8]) {
        self.length(bytes.len());
        self.bytes.extend(bytes);
    }

    pub(super) fn finish(self) -> Vec<u8> {
        self.bytes
    }
}

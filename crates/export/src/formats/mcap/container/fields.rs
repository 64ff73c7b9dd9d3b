//! Fields of records: numbers are little-endian, texts and lists begin with their size in 32 bits.

/// The kind and the length of a record.
pub(super) fn head(opcode: u8, length: usize) -> Vec<u8> {
    [&[opcode][..], &(length as u64).to_le_bytes()].concat()
}

/// A record.
pub(super) fn record(opcode: u8, content: &[u8]) -> Vec<u8> {
    [&head(opcode, content.len()), content].concat()
}

/// A list, or a text, by its bytes.
///
/// # Panics
/// It has 4 GiB or more.
pub(super) fn sized(bytes: &[u8]) -> Vec<u8> {
    let size = u32::try_from(bytes.len()).expect("lists are smaller than 4 GiB");
    [&size.to_le_bytes(), bytes].concat()
}

/// A text.
pub(super) fn text(text: &str) -> Vec<u8> {
    sized(text.as_bytes())
}

/// Numbers of 64 bits.
pub(super) fn numbers(values: &[u64]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

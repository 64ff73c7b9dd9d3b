//! From a sound file to a damaged one.

use crate::corpus::Corpus;
use crate::random::Random;

/// Maximum length of a mutated file.
const MAX_LEN: usize = 1 << 18;
/// Numbers that are likely to break readers.
const EDGES: [u64; 12] = [
    0,
    1,
    0x7f,
    0x80,
    0xff,
    0x7fff,
    0xffff,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x7ff8_0000_0000_0000,
    u64::MAX,
];
/// Words that text readers know, and some that they do not.
const WORDS: [&str; 16] = [
    "nan",
    "inf",
    "-1",
    "1e999",
    "99999999999999999999",
    "0",
    "-0",
    "null",
    "true",
    "[]",
    "{}",
    "\"\"",
    " ",
    "\n",
    "&a *a",
    "list",
];

/// A file of the corpus with some changes, now and then with many.
pub(crate) fn mutated(corpus: &Corpus, random: &mut Random) -> Vec<u8> {
    let mut file = random.pick(corpus).1.clone();
    let changes = if random.once_in(8) { 1 + random.below(40) } else { 1 + random.below(4) };
    for _ in 0..changes {
        change(&mut file, corpus, random);
    }
    file.truncate(MAX_LEN);
    file
}

fn change(file: &mut Vec<u8>, corpus: &Corpus, random: &mut Random) {
    if file.is_empty() {
        file.push(0);
    }
    let at = random.below(file.len());
    let end = (at + 1 + random.below(16)).min(file.len());
    match random.below(12) {
        0 | 1 => file[at] ^= 1 << random.below(8),
        2 => file[at] = random.next().to_le_bytes()[0],
        3 | 4 => {
            let edge = random.pick(&EDGES).wrapping_add(random.below(3) as u64).wrapping_sub(1);
            let width = *random.pick(&[1, 2, 4, 8]);
            let (little, big) = (edge.to_le_bytes(), edge.to_be_bytes());
            let bytes = if random.once_in(3) { &big[8 - width..] } else { &little[..width] };
            let end = (at + width).min(file.len());
            file[at..end].copy_from_slice(&bytes[..end - at]);
        }
        5 => file.truncate(at),
        6 => drop(file.drain(at..end)),
        7 => {
            let piece = file[at..end].to_vec();
            file.splice(at..at, piece.repeat(1 + random.below(4)));
        }
        8 => {
            let word = random.pick(&WORDS).as_bytes().to_vec();
            file.splice(at..end.min(at + word.len()), word);
        }
        9 => number(file, at, random),
        10 => {
            let other = &random.pick(corpus).1;
            let from = random.below(other.len());
            let len = random.below(64).min(other.len() - from);
            let keep = if random.once_in(2) { at } else { (at + len).min(file.len()) };
            file.splice(at..keep, other[from..from + len].iter().copied());
        }
        _ => {
            let to = random.below(file.len());
            file.swap(at, to);
        }
    }
}

/// Replaces the next run of digits by another number.
fn number(file: &mut Vec<u8>, at: usize, random: &mut Random) {
    let Some(begin) = file[at..].iter().position(u8::is_ascii_digit).map(|n| at + n) else { return };
    let len = file[begin..].iter().take_while(|b| b.is_ascii_digit()).count();
    let number =
        if random.once_in(2) { random.pick(&EDGES).to_string() } else { random.below(300).to_string() };
    file.splice(begin..begin + len, number.into_bytes());
}

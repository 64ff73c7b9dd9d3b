//! Labels in pictures: the letters of numbers and units, 5 columns by 7 rows.

use gs2e_image::{Image, Size};

/// Distance between letters, px.
const STEP: u32 = 6;
const COLOUR: [u8; 3] = [64; 3];

/// Columns of a letter, with the top row in the lowest bit. Unknown letters are blank.
fn letter_columns(letter: char) -> [u8; 5] {
    match letter {
        '0' => [0x3e, 0x51, 0x49, 0x45, 0x3e],
        '1' => [0x00, 0x42, 0x7f, 0x40, 0x00],
        '2' => [0x42, 0x61, 0x51, 0x49, 0x46],
        '3' => [0x21, 0x41, 0x45, 0x4b, 0x31],
        '4' => [0x18, 0x14, 0x12, 0x7f, 0x10],
        '5' => [0x27, 0x45, 0x45, 0x45, 0x39],
        '6' => [0x3c, 0x4a, 0x49, 0x49, 0x30],
        '7' => [0x01, 0x71, 0x09, 0x05, 0x03],
        '8' => [0x36, 0x49, 0x49, 0x49, 0x36],
        '9' => [0x06, 0x49, 0x49, 0x29, 0x1e],
        '.' => [0x00, 0x60, 0x60, 0x00, 0x00],
        '-' => [0x08; 5],
        '/' => [0x20, 0x10, 0x08, 0x04, 0x02],
        'e' => [0x38, 0x54, 0x54, 0x54, 0x18],
        'v' => [0x1c, 0x20, 0x40, 0x20, 0x1c],
        's' => [0x48, 0x54, 0x54, 0x54, 0x20],
        'k' => [0x7f, 0x10, 0x28, 0x44, 0x00],
        'M' => [0x7f, 0x02, 0x0c, 0x02, 0x7f],
        'G' => [0x3e, 0x41, 0x49, 0x49, 0x7a],
        _ => [0; 5],
    }
}

/// Width of a text, px.
pub(super) fn text_width(text: &str) -> u32 {
    STEP * u32::try_from(text.chars().count()).expect("labels are short")
}

/// Draws a text with its upper left corner at a pixel. Parts outside the picture are clipped.
pub(super) fn draw_text(image: &mut Image<[u8; 3]>, [left, top]: [u32; 2], text: &str) {
    let Size { width, height } = image.size();
    for (place, letter) in (0u32..).zip(text.chars()) {
        for (column, bits) in (0u32..).zip(letter_columns(letter)) {
            for row in (0u32..7).filter(|row| bits >> row & 1 == 1) {
                let (x, y) = (left + place * STEP + column, top + row);
                if x < width && y < height {
                    image.pixels_mut()[y as usize * width as usize + x as usize] = COLOUR;
                }
            }
        }
    }
}

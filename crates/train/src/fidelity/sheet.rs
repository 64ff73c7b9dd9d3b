//! The picture of some compared views: one row per view, with the photo, the rendering and their
//! difference. The pictures are small: they show what is wrong, and replace no photo.

use gs2e_image::{Image, Size, shrink};

/// Number of rows, at most.
pub const MAX_ROWS: usize = 6;
/// Width of each of the three pictures, px, at most.
const CELL: u32 = 160;
/// Factor on the difference, so that a tenth of the range is well visible.
const GAIN: u16 = 4;
/// Width of the lines between pictures, px, and their colour.
const LINE: u32 = 2;
const LINE_COLOUR: [u8; 3] = [255; 3];

/// Rows of pictures.
#[derive(Debug, Default)]
pub struct ComparisonSheet {
    rows: Vec<[Image<[u8; 3]>; 3]>,
}

impl ComparisonSheet {
    /// Adds a row: a photo and its rendering, which have the same size.
    pub fn push(&mut self, photo: &Image<[u8; 3]>, rendering: &Image<[u8; 3]>) {
        let pairs = photo.pixels().iter().zip(rendering.pixels());
        let apart = |a: u8, b: u8| (GAIN * u16::from(a.abs_diff(b))).min(255) as u8;
        let difference = pairs.map(|(a, b)| std::array::from_fn(|c| apart(a[c], b[c]))).collect();
        let difference = Image::from_vec(photo.size(), difference);
        self.rows.push([photo, rendering, &difference].map(|picture| shrink::to_width(picture, CELL)));
    }

    /// The rows below each other; `None` without rows.
    #[must_use]
    pub fn into_image(self) -> Option<Image<[u8; 3]>> {
        let width = self.rows.iter().map(|row| 3 * row[0].size().width + 2 * LINE).max()?;
        let mut pixels: Vec<[u8; 3]> = Vec::new();
        for (number, row) in self.rows.iter().enumerate() {
            let line = if number > 0 { LINE * width } else { 0 };
            pixels.extend((0..line).map(|_| LINE_COLOUR));
            for y in 0..row[0].size().height as usize {
                let end = pixels.len() + width as usize;
                for (place, picture) in row.iter().enumerate() {
                    let gap = if place > 0 { LINE } else { 0 };
                    pixels.extend((0..gap).map(|_| LINE_COLOUR));
                    let own = picture.size().width as usize;
                    pixels.extend(&picture.pixels()[y * own..(y + 1) * own]);
                }
                // Photos narrower than others leave room at the right.
                pixels.resize(end, LINE_COLOUR);
            }
        }
        let height = u32::try_from(pixels.len() / width as usize).ok()?;
        Some(Image::from_vec(Size { width, height }, pixels))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_the_photo_the_rendering_and_their_difference() {
        assert_eq!(ComparisonSheet::default().into_image(), None);
        let picture = |width, value| Image::filled(Size { width, height: 2 }, [value, 0, 100]);
        let mut sheet = ComparisonSheet::default();
        sheet.push(&picture(2, 10), &picture(2, 30));
        sheet.push(&picture(1, 200), &picture(1, 30));
        let image = sheet.into_image().unwrap();
        assert_eq!(image.size(), Size { width: 10, height: 6 });
        let reds =
            |y: usize| image.pixels()[10 * y..10 * (y + 1)].iter().map(|rgb| rgb[0]).collect::<Vec<_>>();
        assert_eq!(reds(1), [10, 10, 255, 255, 30, 30, 255, 255, 80, 80]);
        assert_eq!(reds(3), [255; 10]);
        // 170 four times is more than white.
        assert_eq!(reds(4), [200, 255, 255, 30, 255, 255, 255, 255, 255, 255]);
    }
}

//! Pictures for passes whose result is easier to see than to read.

use crate::stage::{StageContext, StageError};
use gs2e_check::StreamTally;
use gs2e_image::{Image, Size, png};
use std::fs::File;
use std::io::BufWriter;

/// Size of a residual, relative to the largest one without noise, above which it is shown in another
/// colour.
const IMPOSSIBLE: f32 = 1.1;
/// Maximum width of a picture, px.
const WIDEST: u32 = 320;

/// Writes the pictures of a stream. `name` is its suffix; empty for the only stream. Residuals are
/// drawn if they are `balanced`.
pub(super) fn write_pictures(
    name: &str,
    tally: &StreamTally,
    balanced: bool,
    cx: &StageContext<'_>,
) -> Result<(), StageError> {
    let prefix = name.strip_prefix('/').map_or_else(String::new, |name| format!("{name}."));
    let save = |check: &str, image: &Image<[u8; 3]>| {
        let path = cx.out.join(format!("{prefix}{check}.png"));
        let write = |file| png::write_image(image, BufWriter::new(file));
        File::create(&path).and_then(write).map_err(StageError::io_error(&path))
    };
    if balanced && !tally.compared.residuals.is_empty() {
        save("event_frame", &residual_picture(tally.size, &tally.compared.residuals))?;
    }
    if let Some([in_place, moved]) = &tally.window {
        save(
            "motion",
            &join_images(&[count_picture(tally.size, in_place), count_picture(tally.size, moved)]),
        )?;
    }
    Ok(())
}

/// The residual drift of each pixel. Red: brighter than its events say; blue: darker; yellow:
/// impossible without noise.
fn residual_picture(size: Size, residuals: &[f32]) -> Image<[u8; 3]> {
    let colour = |left: f32| match left {
        left if left.abs() > IMPOSSIBLE || left.is_nan() => [255.0, 220.0, 0.0],
        left if left > 0.0 => [255.0, 255.0 * (1.0 - left), 255.0 * (1.0 - left)],
        left => [255.0 * (1.0 + left), 255.0 * (1.0 + left), 255.0],
    };
    let step = block_size(size);
    // The worst pixel of each block, so that a single bad pixel is visible.
    shrink_blocks(size, step, |block| {
        let worst = block.map(|i| residuals[i]).fold(0.0f32, |a, b| if b.abs() > a.abs() { b } else { a });
        colour(worst)
    })
}

/// Counts from white (none) to black (the count that all but one in a thousand do not exceed).
fn count_picture(size: Size, counts: &[u16]) -> Image<[u8; 3]> {
    let mut sorted = counts.to_vec();
    let at = counts.len() - 1 - counts.len() / 1000;
    // At least 1, because a window without events would divide by 0.
    let full = f32::from((*sorted.select_nth_unstable(at).1).max(1));
    let step = block_size(size);
    shrink_blocks(size, step, |block| {
        let (sum, n) = block.fold((0.0, 0.0), |(sum, n), i| (sum + f32::from(counts[i]), n + 1.0));
        [255.0 * (1.0 - (sum / n / full).min(1.0)); 3]
    })
}

fn block_size(size: Size) -> u32 {
    size.width.div_ceil(WIDEST).max(1)
}

/// One pixel per block of `step` by `step`.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "values from 0 to 255")]
fn shrink_blocks(
    size: Size,
    step: u32,
    colour: impl Fn(&mut dyn Iterator<Item = usize>) -> [f32; 3],
) -> Image<[u8; 3]> {
    let small = Size { width: size.width.div_ceil(step), height: size.height.div_ceil(step) };
    let block = |x: u32, y: u32| {
        let rows = y * step..((y + 1) * step).min(size.height);
        let columns = x * step..((x + 1) * step).min(size.width);
        rows.flat_map(move |y| columns.clone().map(move |x| y as usize * size.width as usize + x as usize))
    };
    let row = |y| (0..small.width).map(move |x| (x, y));
    let pixels = (0..small.height).flat_map(row);
    let pixels = pixels.map(|(x, y)| colour(&mut block(x, y)).map(|v| v.round() as u8));
    Image::from_vec(small, pixels.collect())
}

/// Two images of one size next to each other, with a line between them.
fn join_images([left, right]: &[Image<[u8; 3]>; 2]) -> Image<[u8; 3]> {
    let Size { width, height } = left.size();
    let rows = left.pixels().chunks(width as usize).zip(right.pixels().chunks(width as usize));
    let pixels = rows.flat_map(|(a, b)| [a, &[[128; 3]], b].concat()).collect();
    Image::from_vec(Size { width: 2 * width + 1, height }, pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_impossible_pixel_is_seen_in_a_picture_that_is_smaller() {
        let size = Size { width: 700, height: 5 };
        let mut left = vec![0.0; 3500];
        left[3 * 700 + 302] = -1.4;
        left[1] = 0.5;
        let picture = residual_picture(size, &left);
        assert_eq!(picture.size(), Size { width: 234, height: 2 });
        assert_eq!(picture.pixels()[234 + 100], [255, 220, 0]);
        assert_eq!(picture.pixels()[0], [255, 128, 128]);
        let odd = picture.pixels().iter().filter(|p| **p != [255; 3]).count();
        assert_eq!(odd, 2);
    }

    #[test]
    fn counts_stand_beside_each_other() {
        let size = Size { width: 2, height: 2 };
        let picture = join_images(&[count_picture(size, &[0, 1, 2, 4]), count_picture(size, &[0; 4])]);
        let grey: Vec<u8> = picture.pixels().iter().map(|p| p[0]).collect();
        assert_eq!(grey, [255, 191, 128, 255, 255, 128, 0, 128, 255, 255]);
    }
}

//! Compressed `.ply` (playcanvas/splat-transform, `decompress-ply.ts`): 16 bytes per Gaussian
//! relative to the bounds of its chunk of 256, and harmonics in bytes.
//!
//! Element `chunk` has the bounds (those of colours are optional), element `vertex` four packed
//! words, and the optional element `sh` has `f_rest_*` channel by channel. Axes are those of plain
//! files.

use super::body::{self, ElementRows, field_bytes};
use super::degree_of;
use super::header::{BodyEncoding, NumberType, PlyElement, PlyHeader, PropertyKind};
use crate::collector::{Gaussian, GaussianCollector};
use crate::cursor::ByteCursor;
use crate::opacity::logit_of_byte;
use crate::{Gaussians, SceneError, sh};
use glam::DVec3;
use std::f64::consts::SQRT_2;

/// Number of Gaussians in a chunk.
const CHUNK: usize = 256;

/// Returns true if a file with these vertices is compressed.
pub(super) fn is_packed(vertices: &PlyElement) -> bool {
    vertices.has(WORDS[0])
}

/// Returns true if the vertices' property with this name is read.
pub(super) fn knows_property(name: &str) -> bool {
    WORDS.contains(&name)
}

/// The vertices' properties.
const WORDS: [&str; 4] = ["packed_position", "packed_scale", "packed_rotation", "packed_color"];

/// Reads the body of a compressed file.
pub(super) fn read_packed(header: &PlyHeader, cursor: ByteCursor) -> Result<Gaussians, SceneError> {
    let layout = PackedLayout::find_layout(header, &cursor)?;
    let mut buffer = Vec::new();
    let mut cursor = body::binary_body(header, cursor, &mut buffer)?;
    let [chunks, vertices, harmonics] = body::element_rows(header, ["chunk", "vertex", "sh"], &mut cursor)?;
    let chunks = layout.chunks(chunks, &cursor)?;
    let rest_len = sh::function_count(layout.sh_degree) - 1;
    let mut collector = GaussianCollector::new(layout.sh_degree, layout.vertices.count)?;
    let mut coefficients = vec![[0.0; 3]; rest_len + 1];
    for i in 0..layout.vertices.count {
        let word = |k: usize| layout.vertices.u32(vertices, i, layout.words[k]);
        let chunk = &chunks[i / CHUNK];
        // From the highest byte down: red, green, blue, opacity.
        let colour = word(3).to_be_bytes();
        coefficients[0] = chunk.coefficients(colour);
        for (k, coefficient) in coefficients[1..].iter_mut().enumerate() {
            *coefficient = [0, 1, 2].map(|channel| {
                let column = layout.rest[channel * rest_len + k];
                byte_harmonic(harmonics.bytes[i * layout.harmonics.stride + column])
            });
        }
        collector.push(&Gaussian {
            position: chunk.position.at(packed_thirds(word(0))),
            log_scale: chunk.log_scale.at(packed_thirds(word(1))),
            rotation: packed_rotation(word(2)),
            opacity_logit: logit_of_byte(colour[3]),
            sh: &coefficients,
        });
    }
    collector.finish(DVec3::ZERO, header.notes.antialiased)
}

/// Places of the numbers of the three elements.
struct PackedLayout {
    chunks: PackedTable,
    /// Minima and maxima of positions, log scales and, if present, colours.
    bounds: Vec<usize>,
    vertices: PackedTable,
    /// Position, scale, rotation, colour.
    words: [usize; 4],
    harmonics: PackedTable,
    /// `f_rest_*` in file order.
    rest: Vec<usize>,
    sh_degree: u8,
}

impl PackedLayout {
    fn find_layout(header: &PlyHeader, at: &ByteCursor) -> Result<Self, SceneError> {
        let [chunk, vertex] = [header.element("chunk", at)?, header.element("vertex", at)?];
        let harmonics = header.elements.iter().find(|e| e.name == "sh");
        let count = vertex.count;
        // Rows are indexed without further tests, so the counts are compared first.
        check_rows(chunk, count.div_ceil(CHUNK), at)?;
        harmonics.map_or(Ok(()), |sh| check_rows(sh, count, at))?;
        let rest_len =
            harmonics.map_or(0, |sh| sh.properties.iter().filter(|p| p.name.starts_with("f_rest_")).count());
        let word = |name: &str| property_offset(vertex, name, NumberType::U32, at);
        let rest = harmonics.map_or(Ok(Vec::new()), |sh| {
            (0..rest_len).map(|k| property_offset(sh, &format!("f_rest_{k}"), NumberType::U8, at)).collect()
        })?;
        Ok(Self {
            chunks: PackedTable::for_element(chunk, header.encoding, at)?,
            bounds: bound_columns(chunk, at)?,
            vertices: PackedTable::for_element(vertex, header.encoding, at)?,
            words: [word(WORDS[0])?, word(WORDS[1])?, word(WORDS[2])?, word(WORDS[3])?],
            harmonics: harmonics
                .map_or(Ok(PackedTable::default()), |sh| PackedTable::for_element(sh, header.encoding, at))?,
            rest,
            sh_degree: degree_of(rest_len, at)?,
        })
    }

    fn chunks(&self, rows: ElementRows, at: &ByteCursor) -> Result<Vec<PackedChunk>, SceneError> {
        (0..self.chunks.count)
            .map(|i| {
                let mut bounds = [0.0; 18];
                for (bound, &column) in bounds.iter_mut().zip(&self.bounds) {
                    *bound = self.chunks.f32(rows, i, column);
                    if !bound.is_finite() {
                        let place = rows.offset + i * self.chunks.stride + column;
                        return Err(at.at(place).malformed(format!("the bound {bound}"), "a finite number"));
                    }
                }
                Ok(PackedChunk::from_bounds(bounds, self.bounds.len() == bounds.len()))
            })
            .collect()
    }
}

/// The columns of a chunk's bounds. Those of colours are present together or not at all.
fn bound_columns(chunk: &PlyElement, at: &ByteCursor) -> Result<Vec<usize>, SceneError> {
    const NAMES: [&str; 18] = [
        "min_x",
        "min_y",
        "min_z",
        "max_x",
        "max_y",
        "max_z",
        "min_scale_x",
        "min_scale_y",
        "min_scale_z",
        "max_scale_x",
        "max_scale_y",
        "max_scale_z",
        "min_r",
        "min_g",
        "min_b",
        "max_r",
        "max_g",
        "max_b",
    ];
    let coloured = NAMES[12..].iter().any(|name| chunk.has(name));
    let names = if coloured { &NAMES[..] } else { &NAMES[..12] };
    names.iter().map(|name| property_offset(chunk, name, NumberType::F32, at)).collect()
}

fn check_rows(element: &PlyElement, wanted: usize, at: &ByteCursor) -> Result<(), SceneError> {
    if element.count == wanted {
        return Ok(());
    }
    let found = format!("{} rows of `{}`", element.count, element.name);
    Err(at.malformed(found, format!("{wanted}, to match the vertices")))
}

/// Offset of `property` in a row, bytes.
fn property_offset(
    element: &PlyElement,
    property: &str,
    number: NumberType,
    at: &ByteCursor,
) -> Result<usize, SceneError> {
    let Some(i) = element.properties.iter().position(|p| p.name == property) else {
        let name = &element.name;
        return Err(at.malformed(
            format!("no property `{property}` of `{name}`"),
            "the property of a compressed file",
        ));
    };
    let kind = element.properties[i].kind;
    if kind != PropertyKind::One(number) {
        return Err(at.malformed(format!("property `{property}` of type {kind:?}"), format!("{number:?}")));
    }
    let before = element.properties[..i].iter();
    Ok(before.map(|p| if let PropertyKind::One(number) = p.kind { number.size() } else { 0 }).sum())
}

/// Rows of equal length.
#[derive(Debug, Clone, Copy, Default)]
struct PackedTable {
    count: usize,
    stride: usize,
    is_big_endian: bool,
}

impl PackedTable {
    fn for_element(
        element: &PlyElement,
        encoding: BodyEncoding,
        at: &ByteCursor,
    ) -> Result<Self, SceneError> {
        let stride = element.flat_stride(at)?;
        Ok(Self { count: element.count, stride, is_big_endian: encoding == BodyEncoding::BigEndian })
    }

    fn u32(self, rows: ElementRows, row: usize, column: usize) -> u32 {
        let word = field_bytes(rows.bytes, row * self.stride + column);
        if self.is_big_endian { u32::from_be_bytes(word) } else { u32::from_le_bytes(word) }
    }

    fn f32(self, rows: ElementRows, row: usize, column: usize) -> f32 {
        f32::from_bits(self.u32(rows, row, column))
    }
}

/// The bounds of a chunk's Gaussians.
struct PackedChunk {
    position: AxisBounds,
    log_scale: AxisBounds,
    colour: AxisBounds,
}

impl PackedChunk {
    fn from_bounds(bounds: [f32; 18], coloured: bool) -> Self {
        let three = |k: usize| [bounds[k], bounds[k + 1], bounds[k + 2]];
        let range = |k: usize| AxisBounds { min: three(k), max: three(k + 3) };
        // Files without these bounds store colours of 0 to 1.
        let colour = if coloured { range(12) } else { AxisBounds { min: [0.0; 3], max: [1.0; 3] } };
        Self { position: range(0), log_scale: range(6), colour }
    }

    /// The coefficients of degree 0.
    #[expect(clippy::cast_possible_truncation, reason = "rounded to the 32 bits that are kept")]
    fn coefficients(&self, [r, g, b, _]: [u8; 4]) -> [f32; 3] {
        let colour = self.colour.lerp([r, g, b].map(|byte| f64::from(byte) / 255.0));
        colour.map(|c| ((c - 0.5) / sh::C0) as f32)
    }
}

/// Bounds along three axes.
struct AxisBounds {
    min: [f32; 3],
    max: [f32; 3],
}

impl AxisBounds {
    fn lerp(&self, share: [f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|k| {
            let [min, max] = [self.min[k], self.max[k]].map(f64::from);
            // In this form, both ends are exact.
            min * (1.0 - share[k]) + max * share[k]
        })
    }

    #[expect(clippy::cast_possible_truncation, reason = "rounded to the 32 bits that are kept")]
    fn at(&self, share: [f64; 3]) -> [f32; 3] {
        self.lerp(share).map(|x| x as f32)
    }
}

/// Three fractions of 11, 10 and 11 bits, the first in the highest bits.
fn packed_thirds(word: u32) -> [f64; 3] {
    [(word >> 21, 2047), (word >> 11, 1023), (word, 2047)]
        .map(|(bits, mask)| f64::from(bits & mask) / f64::from(mask))
}

/// The quaternion `w x y z`: the highest two bits are the index of the largest component, and ten
/// bits each are the others in this order.
#[expect(clippy::cast_possible_truncation, reason = "rounded to the 32 bits that are kept")]
fn packed_rotation(word: u32) -> [f32; 4] {
    let largest = (word >> 30) as usize;
    let mut components = [0.0; 4];
    let others = (0..4).filter(|&k| k != largest);
    for (k, shift) in others.zip([20, 10, 0]) {
        // A component that is not the largest lies within `sqrt(1/2)` of 0.
        components[k] = (f64::from(word >> shift & 1023) / 1023.0 - 0.5) * SQRT_2;
    }
    let squares: f64 = components.iter().map(|c| c * c).sum();
    // The three others can be longer than 1, by rounding or in a damaged file.
    components[largest] = (1.0 - squares).max(0.0).sqrt();
    components.map(|c| c as f32)
}

/// A coefficient between -4 and 4. The extreme bytes are the ends; the others are the middles of
/// their steps.
fn byte_harmonic(byte: u8) -> f32 {
    let share = match byte {
        0 => 0.0,
        255 => 1.0,
        _ => (f32::from(byte) + 0.5) / 256.0,
    };
    (share - 0.5) * 8.0
}

#[cfg(test)]
mod tests {
    use crate::ply::read_ply;
    use crate::{Gaussians, SceneError};
    use proptest::prelude::*;
    use std::f32::consts::FRAC_1_SQRT_2;

    /// A file of two Gaussians of degree 1 as ascii.
    const GOOD: &str = "\
ply
format ascii 1.0
element chunk 1
property float min_x
property float min_y
property float min_z
property float max_x
property float max_y
property float max_z
property float min_scale_x
property float min_scale_y
property float min_scale_z
property float max_scale_x
property float max_scale_y
property float max_scale_z
property float min_r
property float min_g
property float min_b
property float max_r
property float max_g
property float max_b
element vertex 2
property uint packed_position
property uint packed_rotation
property uint packed_scale
property uint packed_color
element sh 2
property uchar f_rest_0
property uchar f_rest_1
property uchar f_rest_2
property uchar f_rest_3
property uchar f_rest_4
property uchar f_rest_5
property uchar f_rest_6
property uchar f_rest_7
property uchar f_rest_8
end_header
-1 0 10 1 0 20 -9 -8 -7 -5 -4 -3 -0.5 0 0.5 1.5 1 0.5
2047 1072693248 4292872191 4278190335
4294965248 3757048831 0 855703296
0 255 128 1 2 3 4 5 6
127 128 128 128 128 128 128 128 254
";

    /// The same file with little- or big-endian numbers.
    fn binary(text: &str, is_big: bool) -> Vec<u8> {
        let (header, body) = text.split_once("end_header\n").unwrap();
        let order = if is_big { "binary_big_endian" } else { "binary_little_endian" };
        let mut bytes = format!("{}end_header\n", header.replace("ascii", order)).into_bytes();
        for (row, line) in body.lines().enumerate() {
            for word in line.split(' ') {
                let four = match row {
                    0 => word.parse::<f32>().unwrap().to_bits(),
                    _ => word.parse().unwrap(),
                };
                match row {
                    3.. => bytes.push(u8::try_from(four).unwrap()),
                    _ if is_big => bytes.extend(four.to_be_bytes()),
                    _ => bytes.extend(four.to_le_bytes()),
                }
            }
        }
        bytes
    }

    fn check(scene: &Gaussians) {
        // z has all bits set, the others none; then x and y have.
        assert_eq!(scene.positions, [[-1.0, 0.0, 20.0], [1.0, 0.0, 10.0]]);
        // x and z have all bits set; then none has.
        assert_eq!(scene.log_scales, [[-5.0, -8.0, -3.0], [-9.0, -8.0, -7.0]]);
        let near = |got: &[f32], wanted: &[f32]| {
            for (g, w) in got.iter().zip(wanted) {
                // Expected values have six digits.
                assert!((g - w).abs() <= 1e-5 * w.abs().max(0.1), "{got:?} for {wanted:?}");
            }
        };
        // w is largest, x has all bits set, y and z none; then z is largest, w has 511 of 1023, x
        // none, y all.
        near(&scene.rotations[0], &[0.0, FRAC_1_SQRT_2, -FRAC_1_SQRT_2, -FRAC_1_SQRT_2]);
        near(&scene.rotations[1], &[-0.000_691_207, -FRAC_1_SQRT_2, FRAC_1_SQRT_2, 0.0]);
        near(&scene.opacity_logits, &[6.232_448, -6.232_448]);
        // (1.5 - 0.5) / C0, (0 - 0.5) / C0 and 0; then (-0.5 + 0.2 * 2 - 0.5) / C0.
        near(&scene.sh_of(0)[0], &[3.544_908, -1.772_454, 0.0]);
        near(&scene.sh_of(1)[0], &[-2.126_945, -1.772_454, 0.0]);
        let rest = [
            [-4.0, -3.953_125, -3.859_375],
            [4.0, -3.921_875, -3.828_125],
            [0.015_625, -3.890_625, -3.796_875],
        ];
        assert_eq!(scene.sh_of(0)[1..], rest);
        assert_eq!(scene.sh_of(1)[1][0].to_bits(), (-0.015_625_f32).to_bits());
        assert_eq!((scene.sh_degree, scene.antialiased, scene.screening.read), (1, None, 2));
    }

    #[test]
    fn every_encoding_is_read() {
        for bytes in [GOOD.as_bytes().to_vec(), binary(GOOD, false), binary(GOOD, true)] {
            check(&read_ply(&bytes).unwrap());
        }
    }

    fn error(bytes: &[u8]) -> String {
        read_ply(bytes).map(|_: Gaussians| ()).map_err(|e: SceneError| e.to_string()).unwrap_err()
    }

    #[test]
    fn errors_say_what_was_found_and_wanted() {
        let t = |from: &str, to: &str, message: &str| {
            assert!(GOOD.contains(from), "{from}");
            let error = error(GOOD.replacen(from, to, 1).as_bytes());
            assert!(error.contains(message), "{error}");
        };
        t("element chunk 1", "element chunk 2", "found 2 rows of `chunk`, wanted 1, to match the vertices");
        t("element chunk 1", "element cell 1", "found no element `chunk`");
        t("element sh 2", "element sh 1", "found 1 rows of `sh`, wanted 2");
        t("element vertex 2", "element vertex 257", "found 1 rows of `chunk`, wanted 2");
        t("element vertex 2", "element vertex 99999999999", "found 1 rows of `chunk`, wanted 390625000");
        t(
            "uint packed_scale",
            "float packed_scale",
            "found property `packed_scale` of type One(F32), wanted U32",
        );
        t("uint packed_color", "uint other", "found no property `packed_color` of `vertex`");
        t("float min_x", "double min_x", "found property `min_x` of type One(F64), wanted F32");
        t("property float max_g\n", "", "found no property `max_g` of `chunk`");
        t("float max_g", "list uchar float max_g", "a list among the properties of `chunk` is not supported");
        t("f_rest_8", "f_rest_9", "found no property `f_rest_8` of `sh`");
        t("uchar f_rest_8", "uchar other", "found 8 properties `f_rest_*`, wanted 0, 9, 24 or 45");
        t(" 20 -9", " nan -9", "(as binary) at byte 20: found the bound NaN, wanted a finite number");
        t(" 0.5 1.5", " inf 1.5", "(as binary) at byte 56: found the bound inf, wanted a finite number");
    }

    #[test]
    fn every_truncation_is_an_error() {
        let binary = binary(GOOD, false);
        for whole in [GOOD.as_bytes(), &binary] {
            for len in 0..whole.len() {
                assert!(read_ply(&whole[..len]).is_err(), "{len} of {} bytes", whole.len());
            }
        }
        assert!(error(&[&binary[..], &[0]].concat()).contains("found 1 more bytes"));
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(500) })]

        #[test]
        fn damage_never_panics(at in 0_usize..2000, byte: u8, ascii: bool) {
            let mut bytes = if ascii { GOOD.as_bytes().to_vec() } else { binary(GOOD, false) };
            let at = at % bytes.len();
            bytes[at] = byte;
            let _ = read_ply(&bytes);
        }
    }
}

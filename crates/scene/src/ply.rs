//! Scenes as `.ply` files, the format of 3D Gaussian Splatting itself.
//!
//! Properties are found by name, in any order: `x y z`, `f_dc_0..2`, `f_rest_0..` (0, 9, 24 or 45
//! of them; all of red, then green, then blue), `opacity`, `scale_0..2`, `rot_0..3`, each float or
//! double. Other properties and other elements are skipped. The body is binary of either byte
//! order, or ascii. The format does not record antialiasing. Compressed files, recognised by their
//! elements, are read as well.
//!
//! # Examples
//!
//! ```
//! use gs2e_scene::ply;
//!
//! let names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
//! let properties: String = names.split(' ').map(|name| format!("property float {name}\n")).collect();
//! let head = format!("ply\nformat ascii 1.0\nelement vertex 1\n{properties}end_header\n");
//! let scene = ply::read_ply(format!("{head}1 2 3 0 0 0 0 -1 -1 -1 1 0 0 0\n").as_bytes())?;
//! assert_eq!(scene.positions, [[1.0, 2.0, 3.0]]);
//! // The canonical form keeps every bit.
//! let mut bytes = Vec::new();
//! ply::write_ply(&scene, &mut bytes)?;
//! assert_eq!(ply::read_ply(&bytes)?, scene);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod body;
mod header;
mod notes;
mod packed;
mod position;
mod tracks;
mod write;

use super::collector::{Gaussian, GaussianCollector};
use super::cursor::ByteCursor;
use super::dynamic::HINT;
use super::{Gaussians, SceneError, SceneScreening, sh};
use body::{ElementRows, VertexColumn};
use glam::DVec3;
use header::{BodyEncoding, NumberType, PlyElement, PlyHeader, PropertyKind};
pub use tracks::{TrackColours, read_tracks};
pub(crate) use tracks::{has_tracks_at, write_tracks};
pub use write::write_ply;

/// Reads a `.ply` scene. Positions of 32 bits are kept unchanged; positions of 64 bits are taken
/// relative to an origin near their median. Gaussians that are not finite are dropped and counted.
///
/// # Errors
/// Returns a [`SceneError`] if the bytes are not a `.ply` file, a property is missing, or no
/// Gaussian remains.
pub fn read_ply(bytes: &[u8]) -> Result<Gaussians, SceneError> {
    let mut cursor = ByteCursor::new(".ply", bytes);
    let header = PlyHeader::read(&mut cursor)?;
    let vertices = header.element("vertex", &cursor)?;
    if packed::is_packed(vertices) {
        return packed::read_packed(&header, cursor);
    }
    if tracks::has_tracks(vertices) {
        return Err(cursor.unsupported("a scene that changes with time, with trbf_center", HINT));
    }
    let columns = GaussianColumns::find_columns(vertices, header.encoding, &cursor)?;
    let mut buffer = Vec::new();
    let mut cursor = body::binary_body(&header, cursor, &mut buffer)?;
    let [ElementRows { bytes: rows, .. }] = body::element_rows(&header, ["vertex"], &mut cursor)?;
    let origin = columns.origin(rows, header.notes.origin);
    let mut collector = GaussianCollector::new(columns.sh_degree, rows.len() / columns.stride)?;
    let mut harmonics = vec![[0.0; 3]; sh::function_count(columns.sh_degree)];
    for row in rows.chunks_exact(columns.stride) {
        collector.push(&columns.gaussian(row, origin, &mut harmonics));
    }
    let mut scene = collector.finish(origin, header.notes.antialiased)?;
    // A file of our own notes the counts of its source. Only the Gaussians dropped now are added:
    // zero quaternions are still in the file, and the notes count them already.
    if let Some(noted) = header.notes.screening {
        let non_finite = noted.non_finite.saturating_add(scene.screening.non_finite);
        scene.screening = SceneScreening { non_finite, ..noted };
    }
    Ok(scene)
}

/// Maximum length of a header, bytes.
pub const MAX_HEADER: usize = header::MAX_LEN;

/// Content of a file that [`read_ply`] ignores: properties of its vertices (except normals, which
/// scenes have as zeros), and elements. Empty for a file without a header.
#[must_use]
pub fn left_out(bytes: &[u8]) -> Vec<String> {
    let Ok(header) = PlyHeader::read(&mut ByteCursor::new(".ply", bytes)) else { return Vec::new() };
    let packed = header.elements.iter().any(packed::is_packed);
    let known = |name: &str| if packed { packed::knows_property(name) } else { knows_property(name) };
    let mut names = Vec::new();
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" => names.extend(element.properties.iter().map(|p| p.name.clone()).filter(|n| !known(n))),
            "chunk" | "sh" if packed => {}
            other => names.push(format!("element {other}")),
        }
    }
    names
}

/// Bits of the coordinates of a file with this beginning: 32 or 64. `None` for a compressed file,
/// and for one without a valid header.
#[must_use]
pub fn position_bits(bytes: &[u8]) -> Option<u8> {
    let header = PlyHeader::read(&mut ByteCursor::new(".ply", bytes)).ok()?;
    if header.elements.iter().any(packed::is_packed) {
        return None;
    }
    let vertices = header.elements.iter().find(|element| element.name == "vertex")?;
    let x = vertices.properties.iter().find(|property| property.name == "x")?;
    Some(if x.kind == PropertyKind::One(NumberType::F64) { 64 } else { 32 })
}

fn knows_property(name: &str) -> bool {
    property_names(sh::MAX_DEGREE).iter().any(|known| known == name)
}

/// Places of a Gaussian's numbers in a row.
#[derive(Debug)]
struct GaussianColumns {
    stride: usize,
    position: [VertexColumn; 3],
    log_scale: [VertexColumn; 3],
    rotation: [VertexColumn; 4],
    opacity: VertexColumn,
    /// The coefficients in memory order: `[r, g, b]` of each function.
    sh: Vec<[VertexColumn; 3]>,
    sh_degree: u8,
}

impl GaussianColumns {
    fn find_columns(
        vertices: &PlyElement,
        encoding: BodyEncoding,
        at: &ByteCursor,
    ) -> Result<Self, SceneError> {
        let stride = vertices.flat_stride(at)?;
        let optional = |name: &str| VertexColumn::find_column(vertices, name, encoding, at);
        let column = |name: &str| {
            optional(name)?.ok_or_else(|| {
                let wanted = "x y z, f_dc_0..2, opacity, scale_0..2 and rot_0..3";
                at.malformed(format!("no property `{name}`"), wanted)
            })
        };
        // Counted, not looked up: their number decides the degree, and so which names must exist.
        let rest_len = vertices.properties.iter().filter(|p| p.name.starts_with("f_rest_")).count();
        let sh_degree = degree_of(rest_len, at)?;
        let functions = sh::function_count(sh_degree);
        let mut harmonics = vec![[column("f_dc_0")?, column("f_dc_1")?, column("f_dc_2")?]];
        for k in 0..functions - 1 {
            // The file has all coefficients of red, then all of green, then all of blue.
            let of = |channel: usize| column(&format!("f_rest_{}", channel * (functions - 1) + k));
            harmonics.push([of(0)?, of(1)?, of(2)?]);
        }
        Ok(Self {
            stride,
            position: [column("x")?, column("y")?, column("z")?],
            log_scale: [column("scale_0")?, column("scale_1")?, column("scale_2")?],
            rotation: [column("rot_0")?, column("rot_1")?, column("rot_2")?, column("rot_3")?],
            opacity: column("opacity")?,
            sh: harmonics,
            sh_degree,
        })
    }

    /// The scene's origin: zero for positions of 32 bits, otherwise the one in the notes, or one
    /// near the median.
    fn origin(&self, rows: &[u8], noted: Option<DVec3>) -> DVec3 {
        if !self.position.iter().any(|c| c.is_double()) {
            return DVec3::ZERO;
        }
        noted.unwrap_or_else(|| {
            position::median_origin(self.position.map(|column| {
                rows.chunks_exact(self.stride).map(|row| column.get(row)).filter(|x| x.is_finite()).collect()
            }))
        })
    }

    #[expect(clippy::cast_possible_truncation, reason = "rounded to the 32 bits that are kept")]
    fn gaussian<'a>(&self, row: &[u8], origin: DVec3, harmonics: &'a mut [[f32; 3]]) -> Gaussian<'a> {
        let get = |column: VertexColumn| column.get(row) as f32;
        for (coefficient, columns) in harmonics.iter_mut().zip(&self.sh) {
            *coefficient = columns.map(get);
        }
        let origin = origin.to_array();
        Gaussian {
            position: [0, 1, 2].map(|k| position::to_local(self.position[k].get(row), origin[k])),
            log_scale: self.log_scale.map(get),
            rotation: self.rotation.map(get),
            opacity_logit: get(self.opacity),
            sh: harmonics,
        }
    }
}

fn degree_of(rest_len: usize, at: &ByteCursor) -> Result<u8, SceneError> {
    match rest_len {
        0 => Ok(0),
        9 => Ok(1),
        24 => Ok(2),
        45 => Ok(3),
        72 => Err(at.unsupported("degree 4 of the spherical harmonics", "convert the scene to degree 3")),
        n => Err(at.malformed(format!("{n} properties `f_rest_*`"), "0, 9, 24 or 45")),
    }
}

/// Names of the vertices' properties in the order of 3DGS.
fn property_names(sh_degree: u8) -> Vec<String> {
    let numbered = |name: &str, n: usize| (0..n).map(|i| format!("{name}_{i}")).collect::<Vec<_>>();
    let mut names = ["x", "y", "z", "nx", "ny", "nz"].map(String::from).to_vec();
    names.extend(numbered("f_dc", 3));
    names.extend(numbered("f_rest", 3 * (sh::function_count(sh_degree) - 1)));
    names.push("opacity".into());
    names.extend(numbered("scale", 3));
    names.extend(numbered("rot", 4));
    names
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A file of two Gaussians of degree 1, written number by number. `f_rest_k` of Gaussian `g` is
    /// `100 g + k`. The properties are in an unusual order, with unknown ones among them.
    fn shuffled(encoding: &str, position: &str) -> Vec<u8> {
        let names = "rot_3 f_rest_8 z y x label f_rest_0 f_rest_1 f_rest_2 f_rest_3 f_rest_4 f_rest_5 f_rest_6 \
                     f_rest_7 opacity scale_2 scale_1 scale_0 f_dc_0 f_dc_1 f_dc_2 rot_0 rot_1 rot_2";
        let mut header = format!(
            "ply\r\nformat {encoding} 1.0\ncomment by hand\nelement camera 1\nproperty short id\n\
             element vertex 2\n"
        );
        let mut body = Vec::new();
        put(&mut body, encoding, "short", -2.0);
        let number_of = |name: &str| match name {
            "x" | "y" | "z" => position.to_owned(),
            "label" => "uchar".to_owned(),
            _ => "float".to_owned(),
        };
        for name in names.split_whitespace() {
            header += &format!("property {} {name}\n", number_of(name));
        }
        for g in 0..2 {
            for name in names.split_whitespace() {
                put(&mut body, encoding, &number_of(name), value(name, f64::from(g)));
            }
        }
        header += "element tail 2\nproperty double t\nend_header\n";
        put(&mut body, encoding, "double", 1.0);
        put(&mut body, encoding, "double", 2.0);
        [header.into_bytes(), body].concat()
    }

    fn value(name: &str, g: f64) -> f64 {
        let k: f64 = name.rsplit('_').next().unwrap().parse().unwrap_or(0.0);
        match name.split('_').next().unwrap() {
            "x" => 10.0 + g,
            "y" => 20.0 + g,
            "z" => 30.5 + g,
            "f" if name.starts_with("f_rest") => 100.0 * g + k,
            "f" => 0.25 + k + g,
            "opacity" => -1.5 + g,
            "scale" => -4.0 - k - g,
            "rot" => 0.5 - k + g,
            _ => 7.0,
        }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the values fit")]
    fn put(body: &mut Vec<u8>, encoding: &str, number: &str, v: f64) {
        let little = match number {
            "short" => (v as i16).to_le_bytes().to_vec(),
            "uchar" => vec![v as u8],
            "float" => (v as f32).to_le_bytes().to_vec(),
            _ => v.to_le_bytes().to_vec(),
        };
        match encoding {
            "ascii" => body.extend(format!("{v}\n").into_bytes()),
            "binary_big_endian" => body.extend(little.iter().rev()),
            _ => body.extend(little),
        }
    }

    #[test]
    fn properties_are_found_by_name_in_every_encoding() {
        for encoding in ["binary_little_endian", "binary_big_endian", "ascii"] {
            let scene = read_ply(&shuffled(encoding, "float")).unwrap();
            assert_eq!(scene.origin, DVec3::ZERO);
            assert_eq!(scene.positions, [[10.0, 20.0, 30.5], [11.0, 21.0, 31.5]], "{encoding}");
            assert_eq!(scene.log_scales, [[-4.0, -5.0, -6.0], [-5.0, -6.0, -7.0]]);
            assert_eq!(scene.rotations, [[0.5, -0.5, -1.5, -2.5], [1.5, 0.5, -0.5, -1.5]]);
            assert_eq!(scene.opacity_logits, [-1.5, -0.5]);
            let first = [[0.25, 1.25, 2.25], [0.0, 3.0, 6.0], [1.0, 4.0, 7.0], [2.0, 5.0, 8.0]];
            assert_eq!((scene.sh_degree, scene.sh_of(0)), (1, &first[..]));
            assert_eq!(scene.sh_of(1)[3..], [[102.0, 105.0, 108.0]]);
            assert_eq!((scene.antialiased, scene.screening.read), (None, 2));
        }
    }

    #[test]
    fn what_is_passed_over_is_named() {
        assert_eq!(left_out(&shuffled("ascii", "float")), ["element camera", "label", "element tail"]);
        let mut own = Vec::new();
        write_ply(&read_ply(&shuffled("ascii", "float")).unwrap(), &mut own).unwrap();
        assert_eq!(left_out(&own), [""; 0]);
        assert_eq!(left_out(b"NGSP"), [""; 0]);
    }

    #[test]
    fn double_positions_are_taken_about_their_median() {
        let scene = read_ply(&shuffled("binary_big_endian", "double")).unwrap();
        assert_eq!(scene.origin, DVec3::new(10.0, 20.0, 30.5));
        assert_eq!(scene.positions, [[0.0; 3], [1.0; 3]]);
    }

    /// Precision of 32 bits around the origin for positions a million units away; a second pass
    /// must change nothing.
    #[test]
    fn double_positions_survive_a_round_trip_far_from_zero() {
        let exact: Vec<f64> = (0..100).map(|i| 1e6 + f64::from(i * i) * 0.37).collect();
        let origin = position::median_origin([exact.clone(), exact.clone(), exact.clone()]);
        for &x in &exact {
            let p = position::to_local(x, origin.x);
            // Half an ulp of the largest distance, 1813 - 889 = 2,740 < 4096, is 2^-13.
            assert!((position::to_absolute(p, origin.x) - x).abs() <= 1.3e-4);
            let again = position::to_local(position::to_absolute(p, origin.x), origin.x);
            assert_eq!(again.to_bits(), p.to_bits());
        }
    }

    #[test]
    fn gaussians_that_are_not_finite_are_dropped_and_counted() {
        let two = read_ply(&shuffled("binary_little_endian", "float")).unwrap();
        let mut rows = Vec::new();
        write_ply(&two, &mut rows).unwrap();
        let row_len = 4 * property_names(1).len();
        let first = rows.len() - 2 * row_len;
        // Normals (fields 3 to 5) are ignored; every other field matters.
        for field in (0..row_len / 4).filter(|f| !(3..6).contains(f)) {
            for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                let mut bytes = rows.clone();
                bytes[first + 4 * field..][..4].copy_from_slice(&bad.to_le_bytes());
                let scene = read_ply(&bytes).unwrap();
                assert_eq!((scene.len(), scene.screening.read, scene.screening.non_finite), (1, 2, 1));
                assert_eq!(scene.sh_of(0), two.sh_of(1), "field {field}");
            }
        }
        let all = rows.iter().enumerate().map(|(i, &b)| if i < first { b } else { 0xff });
        let error = read_ply(&all.collect::<Vec<_>>()).unwrap_err().to_string();
        assert_eq!(error, "find a Gaussian to render: of 2 in the scene, 2 hold a NaN or an infinity");
    }

    #[test]
    fn zero_quaternions_are_kept_and_counted() {
        let mut scene = read_ply(&shuffled("ascii", "float")).unwrap();
        scene.rotations[1] = [0.0, -0.0, 0.0, 0.0];
        let mut bytes = Vec::new();
        write_ply(&scene, &mut bytes).unwrap();
        let text = String::from_utf8_lossy(&bytes).replace("comment gs2e screening", "comment   other");
        assert!(text.contains("comment   other read 2 non_finite 0 zero_quaternions 0"));
        let start = bytes.windows(4).position(|w| w == b"gs2e").unwrap();
        bytes[start..start + 4].copy_from_slice(b"none");
        let read = read_ply(&bytes).unwrap();
        assert_eq!(read.rotations[1..], [[0.0; 4]]);
        assert_eq!(read.screening, SceneScreening { read: 2, non_finite: 0, zero_quaternions: 1 });
    }

    #[test]
    fn every_truncation_is_an_error() {
        for encoding in ["binary_little_endian", "ascii"] {
            let whole = shuffled(encoding, "double");
            for len in 0..whole.len() {
                assert!(read_ply(&whole[..len]).is_err(), "{encoding}, {len} of {} bytes", whole.len());
            }
        }
        let more = [shuffled("binary_little_endian", "float"), vec![0]].concat();
        assert!(read_ply(&more).unwrap_err().to_string().contains("found 1 more bytes"));
    }

    #[test]
    fn lists_of_other_elements_are_skipped() {
        let whole = shuffled("binary_little_endian", "float");
        let plain = read_ply(&whole).unwrap();
        let t = |length: &str, bytes: &[u8]| {
            let from = format!("property list {length} uchar c\nelement vertex");
            let text = b"property short id\nelement vertex";
            let at = whole.windows(text.len()).position(|w| w == text).unwrap();
            let body = whole.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
            let changed =
                [&whole[..at], from.as_bytes(), &whole[at + text.len()..body], bytes, &whole[body + 2..]];
            read_ply(&changed.concat())
        };
        assert_eq!(t("uchar", &[3, 1, 2, 3]).unwrap(), plain);
        assert_eq!(t("ushort", &[0, 0]).unwrap(), plain);
        assert!(t("char", &[0xff, 1, 2, 3]).unwrap_err().to_string().contains("a negative length"));
        assert!(t("uint", &[0xff; 4]).is_err());
        assert!(t("float", &[0; 4]).unwrap_err().to_string().contains("an integer type"));
    }

    #[test]
    fn errors_say_what_was_found_and_wanted() {
        let good = String::from_utf8(shuffled("ascii", "float")).unwrap();
        let t = |from: &str, to: &str, message: &str| {
            let bad = good.replacen(from, to, 1);
            let error = read_ply(bad.as_bytes()).unwrap_err().to_string();
            assert!(error.contains(message), "{error}");
        };
        t("ascii 1.0", "ascii 2.0", "read .ply at byte 5: found the line `format ascii 2.0`, wanted format");
        t("vertex 2", "vertex two", "found `two`, wanted a number of rows");
        t("vertex 2", "vertex 99999999999", "wanted a number and the space after it");
        t("vertex 2", "face 2", "found no element `vertex`");
        t("property float x", "property half x", "found the type `half`");
        t("property float x", "property uchar x", "property `x` of type One(U8), wanted float or double");
        t("property float x", "property list uchar float x", "a list among the properties of `vertex`");
        t("property float x", "property float y", "found a second property `y`");
        t("property float opacity", "property float alpha", "found no property `opacity`");
        t("property float f_rest_8", "property float f_rest_9", "found no property `f_rest_8`");
        t("property float f_rest_8", "property float g_rest_8", "found 8 properties `f_rest_*`");
        t("property uchar label", "property uchar packed_position", "found no element `chunk`");
        t("comment by hand", "commentary", "found the line `commentary`");
        t("comment by hand", "comment gs2e antialiased perhaps", "found the note `antialiased perhaps`");
        t("comment by hand", &format!("comment {}", "x".repeat(70_000)), "wanted its end by byte 65536");
        t("\n-1.5\n", "\nx1.5\n", "found `x1.5`, wanted a number of type F32");
    }

    prop_compose! {
        fn any_scene()(degree in 0_u8..=3, n in 1_usize..4)(
            degree in Just(degree),
            n in Just(n),
            origin in prop_oneof![Just([0.0; 3]), (-1e7..1e7_f64, 1e-3..1.0_f64).prop_map(|(x, z)| [x, 0.0, z])],
            numbers in prop::collection::vec(prop_oneof![-1e4..1e4_f32, prop::num::f32::NORMAL], n * (11 + 3 * sh::function_count(degree))),
            antialiased in prop::option::of(any::<bool>()),
            dropped in 0_u64..9,
        ) -> Gaussians {
            let (fields, harmonics) = numbers.split_at(11 * n);
            let origin = DVec3::from_array(origin.map(|o| f64::from(<f32 as sh::Scalar>::nearest(o))));
            let three = |f: &[f32]| [f[0], f[1], f[2]];
            let rows = || fields.chunks_exact(11);
            let settle = |f: &[f32]| {
                let o = origin.to_array();
                [0, 1, 2].map(|k| if o[k] == 0.0 { f[k] } else { position::to_local(o[k] + f64::from(f[k]), o[k]) })
            };
            Gaussians {
                origin,
                positions: rows().map(settle).collect(),
                log_scales: rows().map(|f| three(&f[3..])).collect(),
                rotations: rows().map(|f| [f[6], f[7], f[8], f[9]]).collect(),
                opacity_logits: rows().map(|f| f[10]).collect(),
                sh: harmonics.chunks_exact(3).map(three).collect(),
                sh_degree: degree,
                antialiased,
                screening: SceneScreening { read: n as u64 + dropped, non_finite: dropped, zero_quaternions: 0 },
                motion: None,
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(200) })]

        #[test]
        fn what_is_written_is_read_back_bit_for_bit(scene in any_scene()) {
            let mut bytes = Vec::new();
            write_ply(&scene, &mut bytes).unwrap();
            let again = read_ply(&bytes).unwrap();
            prop_assert_eq!(&again, &scene);
            let bits = |s: &Gaussians| s.positions.as_flattened().iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            prop_assert_eq!(bits(&again), bits(&scene));
            let mut twice = Vec::new();
            write_ply(&again, &mut twice).unwrap();
            prop_assert_eq!(twice, bytes);
        }

        #[test]
        fn damage_never_panics(at in 0_usize..2000, byte in any::<u8>(), ascii in any::<bool>()) {
            let mut bytes = shuffled(if ascii { "ascii" } else { "binary_little_endian" }, "double");
            let at = at % bytes.len();
            bytes[at] = byte;
            let _ = read_ply(&bytes);
        }
    }
}

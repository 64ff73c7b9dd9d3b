//! Scenes with a track per Gaussian, as `.ply` files of Spacetime Gaussians
//! (oppo-us-research/SpacetimeGaussians, `scene/ourslite.py`, `save_ply`).
//!
//! Their vertices have `motion_0..8` (three coefficients of the first power, then of the second and the
//! third), `omega_0..3`, `trbf_center` and `trbf_scale` besides the properties of a scene. Without
//! `f_rest_*`, `f_dc_0..2` are the colour itself. Their variant with a network for colours has more of
//! `f_dc_*` and is refused.

use super::body::{self, ElementRows, VertexColumn};
use super::header::{PlyElement, PlyHeader};
use super::{GaussianColumns, write};
use crate::collector::{Gaussian, GaussianCollector};
use crate::cursor::ByteCursor;
use crate::dynamic::SplatTrack;
use crate::{Gaussians, SceneError, SceneScreening, sh};
use std::io::{self, Write};

/// The meaning of `f_dc_*` in a file without further harmonics.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackColours {
    /// The colour, as in published files.
    Plain,
    /// The coefficient of a constant, as in the files of `write_tracks`.
    Harmonics,
}

/// Names of the properties of a track, in the order of [`write_tracks`].
fn track_names() -> Vec<String> {
    let numbered = |name: &str, count: usize| (0..count).map(|i| format!("{name}_{i}")).collect::<Vec<_>>();
    let mut names = numbered("motion", 9);
    names.extend(numbered("omega", 4));
    names.extend(["trbf_center", "trbf_scale"].map(String::from));
    names
}

/// Returns true if the vertices have tracks.
pub(super) fn has_tracks(vertices: &PlyElement) -> bool {
    vertices.properties.iter().any(|property| property.name == "trbf_center")
}

/// Returns true if a file with this beginning has tracks.
#[must_use]
pub(crate) fn has_tracks_at(bytes: &[u8]) -> bool {
    let header = PlyHeader::read(&mut ByteCursor::new(".ply", bytes));
    header.is_ok_and(|header| header.elements.iter().any(has_tracks))
}

/// Reads a scene and the track of each of its Gaussians. A Gaussian is dropped and counted if a value of it
/// or of its track is not finite.
///
/// # Errors
/// As [`super::read_ply`]; or a property of the tracks is missing.
pub fn read_tracks(bytes: &[u8], colours: TrackColours) -> Result<(Gaussians, Vec<SplatTrack>), SceneError> {
    let mut cursor = ByteCursor::new(".ply", bytes);
    let header = PlyHeader::read(&mut cursor)?;
    let vertices = header.element("vertex", &cursor)?;
    let columns = GaussianColumns::find_columns(vertices, header.encoding, &cursor)?;
    let column = |name: &String| {
        VertexColumn::find_column(vertices, name, header.encoding, &cursor)?.ok_or_else(|| {
            let wanted =
                "motion_0..8, omega_0..3, trbf_center and trbf_scale of a scene that changes with time";
            cursor.malformed(format!("no property `{name}`"), wanted)
        })
    };
    let tracks = track_names().iter().map(column).collect::<Result<Vec<VertexColumn>, _>>()?;
    if vertices.properties.iter().any(|property| property.name == "f_dc_3") {
        let hint = "use a model without it, such as one of the lite configuration";
        return Err(cursor.unsupported("a network for colours, with f_dc_3", hint));
    }
    let plain = colours == TrackColours::Plain && columns.sh_degree == 0;
    let mut buffer = Vec::new();
    let mut cursor = body::binary_body(&header, cursor, &mut buffer)?;
    let [ElementRows { bytes: rows, .. }] = body::element_rows(&header, ["vertex"], &mut cursor)?;
    let origin = columns.origin(rows, header.notes.origin);
    let count = rows.len() / columns.stride;
    let mut collector = GaussianCollector::new(columns.sh_degree, count)?;
    let mut harmonics = vec![[0.0; 3]; sh::function_count(columns.sh_degree)];
    let mut kept = gs2e_files::budget::try_with_room(count)?;
    for row in rows.chunks_exact(columns.stride) {
        let track = track_of(&tracks, row);
        let mut gaussian = columns.gaussian(row, origin, &mut harmonics);
        let constant = [gaussian.sh[0].map(coefficient_of)];
        if plain {
            gaussian = Gaussian { sh: &constant, ..gaussian };
        }
        if !track.is_finite() {
            // The collector sees no track. NaN makes it drop and count the Gaussian.
            gaussian.opacity_logit = f32::NAN;
        }
        if collector.push(&gaussian) {
            kept.push(track);
        }
    }
    let mut scene = collector.finish(origin, header.notes.antialiased)?;
    if let Some(noted) = header.notes.screening {
        let non_finite = noted.non_finite.saturating_add(scene.screening.non_finite);
        scene.screening = SceneScreening { non_finite, ..noted };
    }
    Ok((scene, kept))
}

/// The coefficient of a constant with this colour.
#[expect(clippy::cast_possible_truncation, reason = "scenes hold 32 bits")]
fn coefficient_of(colour: f32) -> f32 {
    ((f64::from(colour) - 0.5) / sh::C0) as f32
}

#[expect(clippy::cast_possible_truncation, reason = "rounded to the 32 bits that are kept")]
fn track_of(columns: &[VertexColumn], row: &[u8]) -> SplatTrack {
    let value = |k: usize| columns[k].get(row) as f32;
    SplatTrack {
        motion: [
            [value(0), value(1), value(2)],
            [value(3), value(4), value(5)],
            [value(6), value(7), value(8)],
        ],
        omega: [value(9), value(10), value(11), value(12)],
        centre: value(13),
        log_width: value(14),
    }
}

/// Writes a scene and the track of each Gaussian, with `f_dc_*` as harmonics.
///
/// # Errors
/// `out` fails.
///
/// # Panics
/// There is not one track per Gaussian.
pub(crate) fn write_tracks(scene: &Gaussians, tracks: &[SplatTrack], out: impl Write) -> io::Result<()> {
    assert_eq!(tracks.len(), scene.len(), "one track per Gaussian");
    let more = |i: usize, row: &mut Vec<u8>| {
        let SplatTrack { motion, omega, centre, log_width } = &tracks[i];
        let values = motion.as_flattened().iter().chain(omega).chain([centre, log_width]);
        values.for_each(|value| row.extend(value.to_le_bytes()));
    };
    write::write_rows(scene, &track_names(), more, out)
}

//! The header lines before the words.

use super::{EDGE, EvtVersion};
use crate::EventFileError;
use gs2e_image::Size;
use std::io::{BufRead, Read as _, Write};

/// Maximum length of a header, bytes.
const MAX_BYTES: u64 = 1 << 16;

/// Writes the header of a stream from a sensor of this size.
pub(super) fn write_header(out: &mut impl Write, version: EvtVersion, size: Size) -> std::io::Result<()> {
    let (number, name) = match version {
        EvtVersion::Evt2 => ("2.0", "EVT2"),
        EvtVersion::Evt3 => ("3.0", "EVT3"),
    };
    let Size { width, height } = size;
    write!(
        out,
        "% evt {number}\n% format {name};width={width};height={height}\n% geometry {width}x{height}\n\
         % integrator_name Prophesee\n% system_ID 49\n% end\n"
    )
}

/// Reads the header, and returns its length as well.
pub(super) fn read_header(input: &mut impl BufRead) -> Result<(EvtVersion, Size, u64), EventFileError> {
    let (mut version, mut size) = (None, None);
    let mut bytes = 0;
    // The header ends with its `end` line, or without one at the first byte that is no `%`. After
    // an `end` line a `%` belongs to a word.
    while input.fill_buf()?.first() == Some(&b'%') {
        let mut line = Vec::new();
        // Limited, because a file of another kind may have no line break at all.
        input.by_ref().take(MAX_BYTES).read_until(b'\n', &mut line)?;
        bytes += line.len() as u64;
        if line.last() != Some(&b'\n') || bytes > MAX_BYTES {
            return Err(EventFileError::Container(format!("byte {bytes}: the header has no end")));
        }
        let line = String::from_utf8_lossy(&line);
        let (key, value) = line[1..].trim().split_once(' ').unwrap_or((line[1..].trim(), ""));
        match key {
            "end" => break,
            "evt" => version = Some(self::parse_version(value)?),
            "format" => {
                let (name, fields) = value.split_once(';').unwrap_or((value, ""));
                version = Some(self::parse_version(name)?);
                // The size of the `format` line counts before that of a `geometry` line.
                size = parse_size(fields).or(size);
            }
            "geometry" => {
                let (width, height) = value.split_once('x').unwrap_or_default();
                size = size.or_else(|| size_pair(width, height));
            }
            _ => {}
        }
    }
    let missing =
        |what: &str| EventFileError::Container(format!("byte {bytes}: the header lacks the {what}"));
    let version = version.ok_or_else(|| missing("format: `% evt 2.0` or `% evt 3.0`"))?;
    let size = size.ok_or_else(|| missing("sensor size: `% geometry WIDTHxHEIGHT`"))?;
    if size.width > EDGE || size.height > EDGE || size.pixels() == 0 {
        let because = format!("a sensor of {size}, wanted 1 to {EDGE} px along each edge");
        return Err(EventFileError::Container(because));
    }
    Ok((version, size, bytes))
}

fn parse_version(name: &str) -> Result<EvtVersion, EventFileError> {
    match name.trim() {
        "2.0" | "EVT2" => Ok(EvtVersion::Evt2),
        "3.0" | "EVT3" => Ok(EvtVersion::Evt3),
        other => Err(EventFileError::Container(format!("the format `{other}`, wanted EVT 2.0 or EVT 3.0"))),
    }
}

/// `width=W;height=H` in any order.
fn parse_size(fields: &str) -> Option<Size> {
    let field = |name: &str| fields.split(';').find_map(|f| f.trim().strip_prefix(name)?.strip_prefix('='));
    size_pair(field("width")?, field("height")?)
}

fn size_pair(width: &str, height: &str) -> Option<Size> {
    Some(Size { width: width.trim().parse().ok()?, height: height.trim().parse().ok()? })
}

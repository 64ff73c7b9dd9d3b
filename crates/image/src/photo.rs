//! Photos as cameras and datasets provide them: JPEG or PNG by content, because datasets name one
//! like the other.
//!
//! # Examples
//!
//! ```
//! use gs2e_image::{Image, Size, photo, png};
//!
//! let size = Size { width: 2, height: 1 };
//! let image = Image::from_vec(size, vec![[255_u8, 0, 0], [0, 0, 255]]);
//! let mut bytes = Vec::new();
//! png::write_image(&image, &mut bytes)?;
//! assert_eq!(photo::read_photo(&bytes, size)?, image);
//! // A camera of another size did not take it.
//! assert!(photo::read_photo(&bytes, Size { width: 1, height: 2 }).is_err());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use super::{Image, Size, jpeg, png};
use std::io::Cursor;

/// The reason why a photo cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum PhotoError {
    /// A JPEG that is damaged or of an unsupported kind.
    #[error("a JPEG that cannot be read: {0}")]
    Jpeg(#[from] jpeg::JpegError),
    /// A PNG that is damaged or of an unsupported kind.
    #[error("a PNG that cannot be read: {0}")]
    Png(#[from] png::PngError),
    /// Another format.
    #[error("neither JPEG nor PNG")]
    Other,
}

/// First bytes of the formats.
const JPEG: [u8; 2] = [0xff, 0xd8];
const PNG: [u8; 4] = *b"\x89PNG";

/// Reads an 8-bit photo by a camera of this size; grey becomes three equal channels.
///
/// # Errors
/// The bytes are damaged, or of another format, depth or size. The size is tested by the header,
/// before anything is decoded.
pub fn read_photo(bytes: &[u8], camera: Size) -> Result<Image<[u8; 3]>, PhotoError> {
    if bytes.starts_with(&JPEG) {
        Ok(jpeg::read_rgb(bytes, Some(camera))?)
    } else if bytes.starts_with(&PNG) {
        Ok(png::read_sized(Cursor::new(bytes), camera)?)
    } else {
        Err(PhotoError::Other)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photos_are_told_by_their_content() {
        let size = Size { width: 5, height: 3 };
        let image = Image::filled(size, [1u8, 2, 3]);
        let read = |bytes: &[u8]| read_photo(bytes, size);
        let mut bytes = Vec::new();
        png::write_image(&image, &mut bytes).unwrap();
        assert_eq!(read(&bytes).unwrap(), image);
        assert!(matches!(read(&bytes[..20]), Err(PhotoError::Png(_))));
        assert!(matches!(read(&JPEG), Err(PhotoError::Jpeg(_))));
        assert!(matches!(read(b"GIF89a"), Err(PhotoError::Other)));
    }
}

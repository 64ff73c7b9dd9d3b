//! Signature of a release: `SHA256SUMS.minisig`, a signature of `SHA256SUMS` in the form of minisign
//! (<https://jedisct1.github.io/minisign/>).
//!
//! `SHA256SUMS` covers every other file, so one signature covers the release. The signature itself is
//! in no list. Signing draws random numbers: two signatures of one release differ, and both verify.

use super::checksum;
use ct_codecs::{Base64, Decoder as _};
use gs2e_files as files;
use gs2e_files::{LinkRule, MAX_DOCUMENT, PathError};
use minisign::{PublicKey, PublicKeyBox, SecretKey, SecretKeyBox, SignatureBox};
use std::fs;
use std::io::{self, Cursor, Write as _};
use std::path::Path;

/// Name of the file of the signature.
pub const NAME: &str = "SHA256SUMS.minisig";

/// Comment that a signature covers; it tells the signatures of this program from others.
const COMMENT: &str = "gs2e release, SHA256SUMS";

/// Length of a signature in base64: 64 bytes.
const SIGNATURE_CHARS: usize = 88;

/// Largest file of a key or of a signature: each is four short lines.
const MAX_BYTES: u64 = 64 << 10;

/// Reason why a release cannot be signed or its signature cannot be verified.
#[derive(Debug, thiserror::Error)]
pub enum SignatureError {
    /// A file cannot be read or written.
    #[error(transparent)]
    Io(#[from] PathError),
    /// A key is not in the form of minisign, or its password is wrong.
    #[error("{name} is not a usable {what} of minisign: {because}")]
    Key {
        /// The file, or the text of the key.
        name: String,
        /// Kind of key.
        what: &'static str,
        /// The fault.
        because: String,
    },
    /// The release cannot be signed.
    #[error("failed to sign: {0}")]
    Sign(String),
}

fn io_error(path: &Path) -> impl FnOnce(io::Error) -> SignatureError {
    move |source| PathError::new(path, source).into()
}

/// Identifier of a key, as minisign prints it: 16 hexadecimal digits.
fn key_id(number: &[u8]) -> String {
    // The format has the bytes in little-endian order, and minisign prints the number as one integer.
    number.iter().rev().map(|byte| format!("{byte:02X}")).collect()
}

/// Bytes of a secret key that name its key derivation, and those of a key without a password.
/// minisign writes no checksum into such a key, which the crate's own reader asks for; a damaged key
/// makes a signature that does not verify.
const KDF: std::ops::Range<usize> = 2..4;
const NO_KDF: [u8; 2] = [0; 2];

/// Length of a public key, which no secret key has: its algorithm, its number, and the key.
const PUBLIC_KEY_BYTES: usize = 42;

/// The bytes of a secret key: the second line of its file.
fn decode_key(text: &str) -> Option<Vec<u8>> {
    Base64::decode_to_vec(text.lines().nth(1)?.trim(), None).ok()
}

/// A secret key, with its public key.
#[derive(Debug)]
pub struct SigningKey {
    secret: SecretKey,
    public: PublicKey,
}

impl SigningKey {
    /// Reads the file of a secret key. `password` is asked for only if the key has one.
    ///
    /// # Errors
    /// The file cannot be read, is not a secret key, or the password is wrong or absent.
    pub fn read(
        path: &Path,
        password: &mut dyn FnMut() -> Result<String, String>,
    ) -> Result<Self, SignatureError> {
        let refuse = |because: String| SignatureError::Key {
            name: path.display().to_string(),
            what: "secret key",
            because,
        };
        let bytes = files::read(path, MAX_BYTES).map_err(io_error(path))?;
        let text = String::from_utf8(bytes).map_err(|_| refuse("it is not UTF-8 text".to_owned()))?;
        let bytes = decode_key(&text).ok_or_else(|| refuse("its second line is not base64".to_owned()))?;
        if bytes.len() == PUBLIC_KEY_BYTES {
            return Err(refuse("it is a public key, wanted the secret key of the pair".to_owned()));
        }
        let secret = if bytes.get(KDF) == Some(&NO_KDF) {
            SecretKey::from_bytes(&bytes).map_err(|e| refuse(e.to_string()))?
        } else {
            let boxed = SecretKeyBox::from_string(&text).map_err(|e| refuse(e.to_string()))?;
            let password = password().map_err(&refuse)?;
            boxed.into_secret_key(Some(password)).map_err(|e| refuse(e.to_string()))?
        };
        let public = PublicKey::from_secret_key(&secret).map_err(|e| refuse(e.to_string()))?;
        Ok(Self { secret, public })
    }

    /// Identifier of the key.
    #[must_use]
    pub fn id(&self) -> String {
        key_id(self.public.keynum())
    }

    /// Signs the release in `dir`, unless it has a signature by this key. Returns true if it was
    /// written. A file of this name that is no signature stays, and is an error.
    ///
    /// # Errors
    /// A file cannot be read or written, or the key cannot sign.
    pub fn sign_release(&self, dir: &Path) -> Result<bool, SignatureError> {
        let sums = read_sums(dir)?;
        match ReleaseSignature::read(dir)? {
            // A new signature would have other bytes although nothing changed, so a sound one stays.
            Some(Ok(found)) if found.is_by(&self.public, &sums) => return Ok(false),
            Some(Err(because)) => {
                return Err(SignatureError::Sign(format!("{NAME} exists and is not a signature: {because}")));
            }
            _ => {}
        }
        let made = minisign::sign(Some(&self.public), &self.secret, sums.as_slice(), Some(COMMENT), None)
            .map_err(|e| SignatureError::Sign(e.to_string()))?;
        let path = dir.join(NAME);
        replace_file(&path, made.into_string().as_bytes()).map_err(io_error(&path))?;
        Ok(true)
    }
}

/// Writes a file under a temporary name next to the release, and renames it: the tree never has a
/// part of it.
fn replace_file(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let parent = path.parent().and_then(Path::parent).filter(|parent| !parent.as_os_str().is_empty());
    let mut file = tempfile::NamedTempFile::new_in(parent.unwrap_or(Path::new(".")))?;
    file.write_all(bytes)?;
    // Before the rename: after a loss of power, the name must not lead to an empty file.
    file.as_file().sync_all()?;
    // A release can be read by everyone, unlike a temporary file.
    let like = fs::metadata(path.with_file_name(checksum::NAME))?.permissions();
    file.as_file().set_permissions(like)?;
    file.persist(path)?;
    Ok(())
}

/// A public key.
#[derive(Debug)]
pub struct PublisherKey {
    public: PublicKey,
}

impl PublisherKey {
    /// Reads a public key: the path of its file, or its second line.
    ///
    /// # Errors
    /// The file cannot be read, or the text is not a public key.
    pub fn read(text: &str) -> Result<Self, SignatureError> {
        let refuse =
            |because: String| SignatureError::Key { name: format!("`{text}`"), what: "public key", because };
        let path = Path::new(text);
        let public = if files::is_there(path) {
            let bytes = files::read(path, MAX_BYTES).map_err(io_error(path))?;
            let text = String::from_utf8(bytes).map_err(|_| refuse("it is not UTF-8 text".to_owned()))?;
            PublicKeyBox::from_string(&text).and_then(PublicKeyBox::into_public_key)
        } else {
            PublicKey::from_base64(text)
        };
        Ok(Self { public: public.map_err(|e| refuse(e.to_string()))? })
    }

    /// Identifier of the key.
    #[must_use]
    pub fn id(&self) -> String {
        key_id(self.public.keynum())
    }

    /// Verifies the signature of the release in `dir`. The error says what is wrong with it.
    ///
    /// # Errors
    /// There is no signature, it is not in the form of minisign, or it is not of this key and these
    /// sums.
    pub fn verify_release(&self, dir: &Path) -> Result<(), String> {
        let sums = read_sums(dir).map_err(|e| e.to_string())?;
        let found = match ReleaseSignature::read(dir).map_err(|e| e.to_string())? {
            None => return Err("the release has no signature".to_owned()),
            Some(found) => found?,
        };
        // `is_by` says only yes or no, so a wrong key is found here, where it can be named.
        let (own, other) = (self.id(), found.key_id());
        if own != other {
            return Err(format!("the signature is by the key {other}, wanted {own}"));
        }
        if found.is_by(&self.public, &sums) {
            Ok(())
        } else {
            Err(format!("the signature does not fit {} and the key {own}", checksum::NAME))
        }
    }
}

/// The signature in a release, not verified.
pub struct ReleaseSignature {
    parsed: SignatureBox,
}

impl std::fmt::Debug for ReleaseSignature {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("ReleaseSignature").field("key_id", &self.key_id()).finish_non_exhaustive()
    }
}

impl ReleaseSignature {
    /// Reads the signature of the release in `dir`: `None` if it is absent, the inner error if it
    /// is not in the form of minisign.
    pub fn read(dir: &Path) -> Result<Option<Result<Self, String>>, SignatureError> {
        let path = dir.join(NAME);
        let bytes = match files::read_with(&path, LinkRule::Refuse, MAX_BYTES) {
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
            read => read.map_err(io_error(&path))?,
        };
        Ok(Some(Self::parse(&bytes)))
    }

    /// Parses the bytes of a signature in its one form.
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, String> {
        let text = str::from_utf8(bytes).map_err(|_| "it is not UTF-8 text".to_owned())?;
        let parsed = SignatureBox::from_string(text).map_err(|e| e.to_string())?;
        // The parser takes a last line of any length, which the verification would not survive, and
        // passes over everything after it.
        let last = text.lines().nth(3).map_or(0, str::len);
        if last == SIGNATURE_CHARS && parsed.to_string() == text {
            Ok(Self { parsed })
        } else {
            Err("it is not in the form of minisign".to_owned())
        }
    }

    /// Returns true if this program made it, as far as its comment says.
    pub fn is_by_this_program(&self) -> bool {
        self.parsed.trusted_comment().is_ok_and(|comment| comment == COMMENT)
    }

    /// The number of the key that made it, in hexadecimal digits.
    #[must_use]
    pub fn key_id(&self) -> String {
        key_id(self.parsed.keynum())
    }

    fn is_by(&self, key: &PublicKey, sums: &[u8]) -> bool {
        // Quiet, no output, and no signature of the legacy form, which does not sign a hash of the data.
        minisign::verify(key, &self.parsed, Cursor::new(sums), true, false, false).is_ok()
    }
}

fn read_sums(dir: &Path) -> Result<Vec<u8>, SignatureError> {
    let path = dir.join(checksum::NAME);
    files::read_with(&path, LinkRule::Refuse, MAX_DOCUMENT).map_err(io_error(&path))
}

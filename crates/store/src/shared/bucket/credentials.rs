//! Keys and region of a profile, from the files that every tool for S3 reads.

use crate::disk::disk_error;
use crate::{BucketEnvironment, StoreError};
use gs2e_files as files;
use object_store::aws::AmazonS3ConfigKey;
use std::io;
use std::path::PathBuf;

/// Settings of a profile.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct SharedProfile {
    /// The access key, its secret, and perhaps a token.
    pub(super) keys: Vec<(AmazonS3ConfigKey, String)>,
    /// The region and the address of the service.
    pub(super) places: Vec<(AmazonS3ConfigKey, String)>,
}

const KEYS: [(&str, AmazonS3ConfigKey); 3] = [
    ("aws_access_key_id", AmazonS3ConfigKey::AccessKeyId),
    ("aws_secret_access_key", AmazonS3ConfigKey::SecretAccessKey),
    ("aws_session_token", AmazonS3ConfigKey::Token),
];

const PLACES: [(&str, AmazonS3ConfigKey); 2] =
    [("region", AmazonS3ConfigKey::Region), ("endpoint_url", AmazonS3ConfigKey::Endpoint)];

impl SharedProfile {
    /// The profile that `AWS_PROFILE` names, or `default`. Empty without files.
    pub(super) fn read(environment: &BucketEnvironment) -> Result<Self, StoreError> {
        let variable = |name: &str| environment.variables.get(name);
        let name = variable("AWS_PROFILE").map_or("default", String::as_str);
        let text = |named: &str, file: &str| -> Result<String, StoreError> {
            let home = || Some(environment.home.as_ref()?.join(".aws").join(file));
            let Some(path) = variable(named).map(PathBuf::from).or_else(home) else {
                return Ok(String::new());
            };
            match files::read_text(&path, files::MAX_TEXT) {
                Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(String::new()),
                text => text.map_err(disk_error("reading", &path)),
            }
        };
        let credentials = text("AWS_SHARED_CREDENTIALS_FILE", "credentials")?;
        let config = text("AWS_CONFIG_FILE", "config")?;
        Ok(Self::of_texts(&credentials, &config, name))
    }

    fn of_texts(credentials: &str, config: &str, name: &str) -> Self {
        // In `config`, all sections but the default one have a word before the name.
        let section = if name == "default" { name.to_owned() } else { format!("profile {name}") };
        let found = |wanted: &[(&str, AmazonS3ConfigKey)]| {
            let value =
                |key: &str| setting(credentials, name, key).or_else(|| setting(config, &section, key));
            wanted.iter().filter_map(|(word, key)| Some((*key, value(word)?.to_owned()))).collect()
        };
        Self { keys: found(&KEYS), places: found(&PLACES) }
    }
}

/// The value of a key in a section of an INI file.
fn setting<'a>(text: &'a str, section: &str, key: &str) -> Option<&'a str> {
    let mut inside = false;
    for line in text.lines().map(str::trim) {
        if let Some(title) = line.strip_prefix('[').and_then(|line| line.split(']').next()) {
            inside = title.trim() == section;
        } else if inside
            && let Some((name, value)) = line.split_once('=')
            && name.trim() == key
        {
            return Some(value.trim());
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_profile_is_read_from_both_files() {
        let credentials = "# keys\n[default]\naws_access_key_id = A\naws_secret_access_key=S=\n[lab]\naws_access_key_id=B\n";
        let config = "[default]\nregion = eu-west-1\n[profile lab]\nregion=eu-north-1\nendpoint_url = http://h:1\naws_session_token = t\n";
        let of = |name| SharedProfile::of_texts(credentials, config, name);
        let pair = |key, value: &str| (key, value.to_owned());
        assert_eq!(
            of("default"),
            SharedProfile {
                keys: vec![
                    pair(AmazonS3ConfigKey::AccessKeyId, "A"),
                    pair(AmazonS3ConfigKey::SecretAccessKey, "S=")
                ],
                places: vec![pair(AmazonS3ConfigKey::Region, "eu-west-1")],
            }
        );
        assert_eq!(
            of("lab"),
            SharedProfile {
                keys: vec![pair(AmazonS3ConfigKey::AccessKeyId, "B"), pair(AmazonS3ConfigKey::Token, "t")],
                places: vec![
                    pair(AmazonS3ConfigKey::Region, "eu-north-1"),
                    pair(AmazonS3ConfigKey::Endpoint, "http://h:1")
                ],
            }
        );
        assert_eq!(of("absent"), SharedProfile::default());
    }
}

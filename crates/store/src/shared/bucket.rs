//! A shared store in a bucket of S3, or of a service with its interface.
//!
//! An object appears whole once its upload ends. Records are created by conditional puts (`If-None-Match:
//! *`), so the first writer wins. Blobs have the names of their bytes, so it does not matter who wrote them.
//!
//! Failed requests are sent again, for two minutes at most, with growing pauses: the service may be
//! throttling, and connections break. A large file is read in ranges and written in parts, so a broken
//! connection costs one of them.

mod credentials;

use super::medium::{MAX_RECORD, SharedBytes, SharedMedium};
use crate::blob::blob_name;
use crate::disk::disk_error;
use crate::record::StoredOutput;
use crate::{BucketEnvironment, Digest, FORMAT, StoreError};
use credentials::SharedProfile;
use object_store::aws::{AmazonS3, AmazonS3Builder, AmazonS3ConfigKey, Checksum};
use object_store::path::Path as ObjectPath;
use object_store::{Error, ObjectStore as _, ObjectStoreExt as _, PutMode, PutPayload, RetryConfig};
use std::fs::File;
use std::io::{Read as _, Write as _};
use std::path::Path;
use std::time::Duration;
use tokio::runtime::{Builder, Runtime};

/// Size of a range or part, bytes. Parts of S3 have 5 MiB at least, and a file 10,000 of them at most.
const PART: u64 = 16 << 20;
/// Longest time for which the library repeats a request.
const PATIENCE: Duration = Duration::from_secs(20);
/// Number of further requests after connections that broke, and the pause before each.
const REPETITIONS: u32 = 5;
const PAUSE: Duration = Duration::from_millis(300);

/// A bucket with a prefix.
#[derive(Debug)]
pub(super) struct SharedBucket {
    bucket: AmazonS3,
    prefix: ObjectPath,
    runtime: Runtime,
    /// As the user named it.
    place: String,
}

impl SharedBucket {
    /// Opens a shared store. With `write`, the bucket must support conditional puts.
    pub(super) fn open(
        bucket: &str,
        prefix: &str,
        environment: &BucketEnvironment,
        write: bool,
    ) -> Result<Self, StoreError> {
        let place =
            if prefix.is_empty() { format!("s3://{bucket}") } else { format!("s3://{bucket}/{prefix}") };
        let refused = |because: String, help| StoreError::Unshareable { place: place.clone(), because, help };
        let named = "name it as s3://BUCKET/PREFIX";
        let prefix = ObjectPath::parse(prefix).map_err(|e| refused(e.to_string(), named))?;
        // Of ring, because aws-lc, the default, takes a minute to compile. An error says that there is one
        // already.
        let _ = rustls::crypto::ring::default_provider().install_default();
        let built = builder(environment)?.with_bucket_name(bucket).build();
        let bucket = built.map_err(|e| refused(last_words(&e), named))?;
        let runtime = Builder::new_multi_thread().worker_threads(1).enable_all().build();
        let runtime = runtime.map_err(disk_error("starting requests to", Path::new(&place)))?;
        let shared = Self { bucket, prefix, runtime, place };
        shared.check_format(write)?;
        if write {
            shared.check_conditions()?;
        }
        Ok(shared)
    }

    fn refused(&self, because: impl Into<String>, help: &'static str) -> StoreError {
        StoreError::Unshareable { place: self.place.clone(), because: because.into(), help }
    }

    fn check_format(&self, write: bool) -> Result<(), StoreError> {
        let found = self.read("VERSION")?;
        let text = found.map(|bytes| String::from_utf8_lossy(&bytes).trim().to_owned());
        match text.as_deref().map(str::parse::<u32>) {
            Some(Ok(found)) if found <= FORMAT => Ok(()),
            Some(_) => Err(StoreError::Newer {
                path: self.place.clone().into(),
                found: text.unwrap_or_default(),
                known: FORMAT,
            }),
            None if write => {
                self.publish(SharedBytes::Memory(format!("{FORMAT}\n").as_bytes()), "VERSION").map(drop)
            }
            None => Ok(()),
        }
    }

    /// Refuses a service that ignores the condition of a put: the last writer would win.
    fn check_conditions(&self) -> Result<(), StoreError> {
        // Another process may try at the same time.
        let drawn = tempfile::Builder::new().prefix("probe-").rand_bytes(16).make(|_| Ok(()));
        let drawn = drawn.map_err(disk_error("naming an object in", Path::new(&self.place)))?;
        let name = drawn.path().file_name().unwrap_or_default().to_string_lossy();
        let name = format!("tmp/{name}");
        self.publish(SharedBytes::Memory(b"1"), &name)?;
        // A repeated request may be answered with "taken", too, so only a second success says something.
        let ignored = self.publish(SharedBytes::Memory(b"2"), &name)?;
        let at = self.at(&name);
        let removed = self.runtime.block_on(self.bucket.delete(&at));
        removed.map_err(|e| self.error("removing", &name, &e))?;
        if ignored {
            let because = "the service ignores `If-None-Match`, so the last writer would win";
            return Err(self.refused(because, "use S3 itself, or a service with conditional puts"));
        }
        Ok(())
    }

    /// Returns true if there is an object of this size.
    fn has(&self, name: &str, size: u64) -> Result<bool, StoreError> {
        let at = self.at(name);
        match self.send(|| self.bucket.head(&at)) {
            Ok(meta) => Ok(meta.size == size),
            Err(e) if is_absent(&e) => Ok(false),
            Err(e) => Err(self.error("reading", name, &e)),
        }
    }

    /// The bytes of an object; `None` if it is absent or has another size.
    fn get(&self, name: &str, has_size: impl Fn(u64) -> bool) -> Result<Option<Vec<u8>>, StoreError> {
        let at = self.at(name);
        let got = self.send(async || {
            let found = self.bucket.get(&at).await?;
            // The size is known before the bytes are read.
            if has_size(found.meta.size) { found.bytes().await.map(Some) } else { Ok(None) }
        });
        match got {
            Ok(bytes) => Ok(bytes.map(|bytes| bytes.to_vec())),
            Err(e) if is_absent(&e) => Ok(None),
            Err(e) => Err(self.error("reading", name, &e)),
        }
    }

    fn at(&self, name: &str) -> ObjectPath {
        name.split('/').fold(self.prefix.clone(), |path, part| path.join(part))
    }

    fn error(&self, doing: &'static str, name: &str, error: &Error) -> StoreError {
        let because = last_words(error);
        if because.contains("NoSuchBucket") {
            return self.refused(
                "there is no such bucket",
                "create it first, or check AWS_ENDPOINT_URL and AWS_REGION",
            );
        }
        StoreError::Bucket { doing, place: format!("{}/{name}", self.place), because }
    }

    /// Sends a request, again where a connection broke in a way that the library does not repeat: within the
    /// answer, or where it cannot know that a second attempt does no harm.
    fn send<T, R: Future<Output = Result<T, Error>>>(&self, request: impl Fn() -> R) -> Result<T, Error> {
        let mut repetitions = REPETITIONS;
        loop {
            match self.runtime.block_on(request()) {
                Err(Error::Generic { .. }) if repetitions > 0 => repetitions -= 1,
                done => return done,
            }
            std::thread::sleep(PAUSE);
        }
    }

    /// Creates a small object. Returns `false` if there is one of that name, which may be this one: the
    /// answer to an earlier attempt may have been lost.
    fn create(&self, bytes: &[u8], name: &str) -> Result<bool, StoreError> {
        let at = self.at(name);
        let payload = PutPayload::from(bytes.to_vec());
        match self.send(|| self.bucket.put_opts(&at, payload.clone(), PutMode::Create.into())) {
            Ok(_) => Ok(true),
            Err(Error::AlreadyExists { .. } | Error::Precondition { .. }) => Ok(false),
            Err(e) => Err(self.error("writing", name, &e)),
        }
    }

    /// Creates or replaces an object with the bytes of a file.
    fn write(&self, path: &Path, name: &str) -> Result<(), StoreError> {
        let size = path.metadata().map_err(disk_error("reading", path))?.len();
        if size > PART {
            return self.write_parts(path, size, name);
        }
        let bytes = std::fs::read(path).map_err(disk_error("reading", path))?;
        self.overwrite(&bytes.into(), name)
    }

    fn overwrite(&self, bytes: &PutPayload, name: &str) -> Result<(), StoreError> {
        let at = self.at(name);
        let put = self.send(|| self.bucket.put(&at, bytes.clone()));
        put.map(drop).map_err(|e| self.error("writing", name, &e))
    }

    /// Writes a large file. It appears when all parts are there.
    fn write_parts(&self, path: &Path, size: u64, name: &str) -> Result<(), StoreError> {
        let at = self.at(name);
        let failed = |e: Error| self.error("writing", name, &e);
        let file = File::open(path).map_err(disk_error("reading", path))?;
        let mut upload = self.runtime.block_on(self.bucket.put_multipart(&at)).map_err(failed)?;
        let mut send = || -> Result<(), StoreError> {
            loop {
                let mut part = Vec::new();
                (&file).take(PART).read_to_end(&mut part).map_err(disk_error("reading", path))?;
                if part.is_empty() {
                    return self.runtime.block_on(upload.complete()).map(drop).map_err(failed);
                }
                self.runtime.block_on(upload.put_part(part.into())).map_err(failed)?;
            }
        };
        let sent = send();
        // The answer to the last request may have been lost: a repetition then finds no upload to end.
        if sent.is_err() && self.has(name, size)? {
            return Ok(());
        }
        if sent.is_err() {
            // Parts of an upload that does not end cost money. If this fails too, a rule of the bucket
            // removes them.
            let _ = self.runtime.block_on(upload.abort());
        }
        sent
    }
}

impl SharedMedium for SharedBucket {
    fn read(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        self.get(name, |size| size <= MAX_RECORD)
    }

    fn take(&self, blob: &StoredOutput, to: &Path) -> Result<bool, StoreError> {
        let (name, size) = (blob_name(&blob.digest), blob.size);
        if size <= PART {
            let Some(bytes) = self.get(&name, |found| found == size)? else { return Ok(false) };
            std::fs::write(to, &bytes).map_err(disk_error("writing", to))?;
            return Ok(Digest::of_bytes(&bytes) == blob.digest);
        }
        if !self.has(&name, size)? {
            return Ok(false);
        }
        let at = self.at(&name);
        let mut file = File::create_new(to).map_err(disk_error("writing", to))?;
        let (mut from, mut hasher) = (0, blake3::Hasher::new());
        while from < size {
            // The object may be replaced between two ranges; the digest over all of them finds that.
            let range = from..size.min(from + PART);
            from = range.end;
            let got = self.send(|| self.bucket.get_range(&at, range.clone()));
            let bytes = got.map_err(|e| self.error("reading", &name, &e))?;
            hasher.update(&bytes);
            file.write_all(&bytes).map_err(disk_error("writing", to))?;
        }
        Ok(Digest::from(hasher.finalize()) == blob.digest)
    }

    fn publish(&self, bytes: SharedBytes<'_>, name: &str) -> Result<bool, StoreError> {
        match bytes {
            SharedBytes::Memory(bytes) => self.create(bytes, name),
            // A blob. Whoever writes it writes the same bytes.
            SharedBytes::File(path) => self.write(path, name).map(|()| true),
        }
    }

    fn replace(&self, bytes: SharedBytes<'_>, name: &str) -> Result<(), StoreError> {
        match bytes {
            SharedBytes::Memory(bytes) => self.overwrite(&bytes.to_vec().into(), name),
            SharedBytes::File(path) => self.write(path, name),
        }
    }

    fn is_sound(&self, blob: &StoredOutput) -> Result<bool, StoreError> {
        // Objects are never there in part, and the service compared the bytes with their checksum.
        self.has(&blob_name(&blob.digest), blob.size)
    }

    fn is_gone(&self, _: &str) -> Result<bool, StoreError> {
        // Only rules of the bucket remove objects, by their age, and this one is new.
        Ok(false)
    }

    fn mark_used(&self, _: &str) -> Result<(), StoreError> {
        Ok(())
    }

    fn place(&self) -> String {
        self.place.clone()
    }
}

/// The settings of the environment, and of the profile where the environment has none. Without keys in
/// either, those of the machine's or container's role are asked for.
fn builder(environment: &BucketEnvironment) -> Result<AmazonS3Builder, StoreError> {
    let profile = SharedProfile::read(environment)?;
    let mut builder = AmazonS3Builder::new()
        // The service compares each upload with its checksum. `is_sound` relies on that and reads no bytes.
        .with_checksum_algorithm(Checksum::SHA256)
        .with_retry(RetryConfig { retry_timeout: PATIENCE, ..RetryConfig::default() });
    for (name, value) in &environment.variables {
        // Other variables are for other tools.
        if let Ok(key) = name.to_ascii_lowercase().parse() {
            builder = builder.with_config(key, value);
        }
    }
    let is_set = |builder: &AmazonS3Builder, key| builder.get_config_value(&key).is_some();
    // A key, its secret and its token belong together, so they never come from two sources.
    if !is_set(&builder, AmazonS3ConfigKey::AccessKeyId) {
        for (key, value) in profile.keys {
            builder = builder.with_config(key, value);
        }
    }
    for (key, value) in profile.places {
        if !is_set(&builder, key) {
            builder = builder.with_config(key, value);
        }
    }
    // A service on this machine or in its own network may have no certificate, if the user names it so.
    let endpoint = builder.get_config_value(&AmazonS3ConfigKey::Endpoint).unwrap_or_default();
    Ok(builder.with_allow_http(endpoint.starts_with("http://")))
}

fn is_absent(error: &Error) -> bool {
    matches!(error, Error::NotFound { .. }) && !last_words(error).contains("NoSuchBucket")
}

/// The message of an error with its causes, on one line.
fn last_words(error: &dyn std::error::Error) -> String {
    let mut words = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let more = error.to_string();
        // Many errors repeat their cause.
        if !words.contains(&more) {
            words = format!("{words}: {more}");
        }
        cause = error.source();
    }
    words.split_whitespace().collect::<Vec<_>>().join(" ")
}

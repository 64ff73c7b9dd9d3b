//! Eight processes with one shared store in a bucket. The service is moto, and a proxy before it throttles,
//! fails, waits and breaks connections.
//!
//! `pip install 'moto[server]'` in a Python of your choice.

mod proxy;

use crate::command::{Outcome, program, say};
use crate::folder::Folder;
use crate::options::Options;
use crate::shards::{PROCESSES, ShardPlace};
use proxy::{FaultyProxy, ProxyMode};
use std::ffi::OsStr;
use std::io::{Read as _, Write as _};
use std::net::{TcpListener, TcpStream};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

const BUCKET: &str = "gs2e";
/// Longest wait for the service to start.
const PATIENCE: Duration = Duration::from_secs(60);
/// Largest share of steps that two processes make.
const MOST_TWICE: f64 = 0.02;

/// Runs it: as `network`, and `--python FILE` (`python3`).
pub(crate) fn run(args: &[String]) -> Outcome {
    let python = Options(args).value("--python").unwrap_or("python3");
    if !program(OsStr::new(python), &["-c", "import moto.server"]).succeeds() {
        return Err(format!("{python} has no moto, and nothing ran: {python} -m pip install 'moto[server]'"));
    }
    let folder = Folder::new("bucket")?;
    let mut place = ShardPlace::new(folder.path(), args)?;
    let service = Service::start(python)?;
    let proxy = FaultyProxy::start(service.port)?;
    place.env = vec![
        ("AWS_ACCESS_KEY_ID", "key".to_owned()),
        ("AWS_SECRET_ACCESS_KEY", "secret".to_owned()),
        ("AWS_REGION", "us-east-1".to_owned()),
        ("AWS_ENDPOINT_URL", format!("http://127.0.0.1:{}", proxy.port)),
    ];
    refusals(&place, &proxy)?;
    service.create_bucket()?;
    proxy.set(ProxyMode::NoConditions);
    refused(&place, "build recipes --store s --shared-store s3://gs2e/x", "ignores `If-None-Match`")?;
    let steps = one_machine(&place)?;

    proxy.set(ProxyMode::Sound);
    let shared = |i: usize| ("s3://gs2e/sound", format!("--shard {}/{PROCESSES}", i + 1));
    let sound = place.all("sound", shared)?;
    say(&format!("shares, without faults: {sound}"));
    say(&format!("requests: {}", proxy.requests(steps)));
    timed("no-op of a shard with its store", || {
        place.ok("build recipes --store stores/sound0 --shard 1/8 --shared-store s3://gs2e/sound")
    })?;
    say(&format!("requests: {}", proxy.requests(steps / PROCESSES)));
    timed("all steps into an empty store", || {
        place.ok("build recipes --store cold --shared-store s3://gs2e/sound")
    })?;
    say(&format!("requests: {}", proxy.requests(steps)));

    proxy.set(ProxyMode::Faulty);
    let shared = |i: usize| ("s3://gs2e/shared", format!("--shard {}/{PROCESSES}", i + 1));
    let first = place.all("first", shared)?;
    say(&format!("shares, with faults: {first}"));
    if first.twice as f64 > MOST_TWICE * first.made as f64 {
        return Err(format!("{} of {} steps were made twice", first.twice, first.made));
    }
    let second =
        place.all("second", |i| ("s3://gs2e/shared", format!("--shard {}/{PROCESSES}", (i + 1) % 8 + 1)))?;
    say(&format!("the share of another, into an empty store: {second}"));
    if second.made > 0 {
        return Err("steps were lost".to_owned());
    }
    place.release("s3://gs2e/shared", "other")?;
    let third = place.all("third", |_| ("s3://gs2e/race", String::new()))?;
    say(&format!("all scenes by each of them at the same time: {third}"));
    place.release("s3://gs2e/race", "raced")?;
    say(&format!("requests: {}", proxy.requests(steps)));
    say(&format!("faults: {}", proxy.faults()));
    Ok(())
}

/// Number of steps of the release of one machine.
fn one_machine(place: &ShardPlace) -> Outcome<usize> {
    place.ok("release recipes --store alone --to one")?;
    let plan = place.command("plan recipes --store alone --json").output().map_err(|e| e.to_string())?;
    Ok(String::from_utf8_lossy(&plan.stdout).matches("\"step\":").count())
}

/// A bucket that is not there.
fn refusals(place: &ShardPlace, proxy: &FaultyProxy) -> Outcome {
    proxy.set(ProxyMode::Sound);
    refused(place, "build recipes --store s --shared-store s3://absent/x", "there is no such bucket")?;
    refused(place, "gc --shared-store s3://gs2e/x --older-than 1d", "is not a folder")?;
    refused(place, "submit recipes --to slurm --shared-store s3://gs2e/x", "is not a folder")
}

fn refused(place: &ShardPlace, args: &str, wanted: &str) -> Outcome {
    let ended = place.command(args).output().map_err(|e| e.to_string())?;
    let said = String::from_utf8_lossy(&ended.stderr).into_owned();
    if ended.status.code() == Some(2) && said.contains(wanted) {
        return Ok(());
    }
    Err(format!("gs2e {args} ended with {}, wanted 2 and `{wanted}`:\n{said}", ended.status))
}

fn timed(what: &str, work: impl FnOnce() -> Outcome<String>) -> Outcome {
    let start = Instant::now();
    work()?;
    say(&format!("{what}: {:.2} s", start.elapsed().as_secs_f64()));
    Ok(())
}

/// The service, ended on drop.
struct Service {
    process: Child,
    port: u16,
}

impl Service {
    fn start(python: &str) -> Outcome<Self> {
        let free = TcpListener::bind("127.0.0.1:0").and_then(|listener| listener.local_addr());
        let port = free.map_err(|e| format!("no free port: {e}"))?.port();
        let mut command = Command::new(python);
        command.args(["-m", "moto.server", "-H", "127.0.0.1", "-p", &port.to_string()]);
        let quiet = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        let process = quiet.spawn().map_err(|e| format!("{python}: {e}"))?;
        let service = Self { process, port };
        let start = Instant::now();
        while TcpStream::connect(("127.0.0.1", port)).is_err() {
            if start.elapsed() > PATIENCE {
                return Err("moto does not start".to_owned());
            }
            sleep(Duration::from_millis(100));
        }
        Ok(service)
    }

    fn create_bucket(&self) -> Outcome {
        let failed = |e: std::io::Error| format!("the bucket cannot be created: {e}");
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).map_err(failed)?;
        let request = format!("PUT /{BUCKET} HTTP/1.0\r\nHost: 127.0.0.1\r\nContent-Length: 0\r\n\r\n");
        stream.write_all(request.as_bytes()).map_err(failed)?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer).map_err(failed)?;
        if answer.contains(" 200 ") {
            Ok(())
        } else {
            Err(format!("the bucket cannot be created:\n{answer}"))
        }
    }
}

impl Drop for Service {
    fn drop(&mut self) {
        // It may have ended by itself.
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

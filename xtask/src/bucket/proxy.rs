//! A proxy of HTTP that damages a part of the requests that pass it.

use crate::command::Outcome;
use std::collections::BTreeMap;
use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

/// The treatment of requests.
#[derive(Clone, Copy)]
pub(crate) enum ProxyMode {
    /// Nothing.
    Sound,
    /// One in four is damaged.
    Faulty,
    /// The condition of a put is removed.
    NoConditions,
}

/// A fault of one request.
#[derive(Clone, Copy)]
enum Fault {
    Throttled,
    Failed,
    Slow,
    HalfUpload,
    LostAnswer,
    CutAnswer,
}

/// Each fault with its share of all requests, in hundredths.
const FAULTS: [(Fault, &str, u64); 6] = [
    (Fault::Throttled, "503", 4),
    (Fault::Failed, "500", 4),
    (Fault::Slow, "slow", 6),
    (Fault::HalfUpload, "half an upload", 4),
    (Fault::LostAnswer, "no answer", 4),
    (Fault::CutAnswer, "half an answer", 4),
];

#[derive(Default)]
struct Counts {
    requests: Mutex<BTreeMap<String, u64>>,
    faults: Mutex<BTreeMap<&'static str, u64>>,
    mode: AtomicU8,
    draws: AtomicU64,
}

/// The proxy. Its threads end with the program.
pub(crate) struct FaultyProxy {
    pub(crate) port: u16,
    counts: Arc<Counts>,
}

impl FaultyProxy {
    /// Starts a proxy before the service at `port` of this machine.
    pub(crate) fn start(port: u16) -> Outcome<Self> {
        let failed = |e: io::Error| format!("the proxy cannot start: {e}");
        let listener = TcpListener::bind("127.0.0.1:0").map_err(failed)?;
        let own = listener.local_addr().map_err(failed)?.port();
        let counts = Arc::new(Counts::default());
        let shared = Arc::clone(&counts);
        thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let counts = Arc::clone(&shared);
                // A connection that breaks is what this proxy is for.
                thread::spawn(move || counts.serve(stream, port).is_ok());
            }
        });
        Ok(Self { port: own, counts })
    }

    pub(crate) fn set(&self, mode: ProxyMode) {
        self.counts.mode.store(mode as u8, Ordering::SeqCst);
        self.counts.requests.lock().expect("no holder panics").clear();
    }

    /// The requests since the last call, and their number per step.
    pub(crate) fn requests(&self, steps: usize) -> String {
        let mut requests = self.counts.requests.lock().expect("no holder panics");
        let all: u64 = requests.values().sum();
        let words: Vec<String> = requests.iter().map(|(method, n)| format!("{n} {method}")).collect();
        requests.clear();
        format!("{}; {:.1} per step", words.join(", "), all as f64 / steps.max(1) as f64)
    }

    pub(crate) fn faults(&self) -> String {
        let faults = self.counts.faults.lock().expect("no holder panics");
        let words: Vec<String> = faults.iter().map(|(fault, n)| format!("{n} {fault}")).collect();
        words.join(", ")
    }
}

impl Counts {
    /// Passes one request on, and closes the connection.
    fn serve(&self, mut client: TcpStream, port: u16) -> io::Result<()> {
        let (mut head, mut body) = read_request(&mut client)?;
        let method = head.split(' ').next().unwrap_or_default().to_owned();
        *self.requests.lock().expect("no holder panics").entry(method.clone()).or_default() += 1;
        let mode = self.mode.load(Ordering::SeqCst);
        if mode == ProxyMode::NoConditions as u8 {
            let is_condition = |line: &&str| line.to_ascii_lowercase().starts_with("if-none-match:");
            head = head.split("\r\n").filter(|line| !is_condition(line)).collect::<Vec<_>>().join("\r\n");
        }
        let fault = (mode == ProxyMode::Faulty as u8).then(|| self.draw(&method, body.is_empty())).flatten();
        match fault {
            Some(Fault::Throttled) => return answer(&mut client, "503 Slow Down", "SlowDown"),
            Some(Fault::Failed) => return answer(&mut client, "500 Internal Server Error", "InternalError"),
            Some(Fault::Slow) => thread::sleep(Duration::from_millis(300)),
            Some(Fault::HalfUpload) => body.truncate(body.len() / 2),
            _ => {}
        }
        let mut service = TcpStream::connect(("127.0.0.1", port))?;
        // One request per connection, so that each has its own fault.
        let head = head.replacen("\r\n", "\r\nConnection: close\r\n", 1);
        service.write_all(head.as_bytes())?;
        service.write_all(&body)?;
        if matches!(fault, Some(Fault::HalfUpload)) {
            service.shutdown(Shutdown::Both)?;
            return client.shutdown(Shutdown::Both);
        }
        let mut back = Vec::new();
        service.read_to_end(&mut back)?;
        match fault {
            Some(Fault::LostAnswer) => back.clear(),
            Some(Fault::CutAnswer) => back.truncate(back.len() / 2),
            _ => {}
        }
        client.write_all(&back)?;
        client.shutdown(Shutdown::Both)
    }

    /// The fault of a request, if it has one.
    fn draw(&self, method: &str, is_empty: bool) -> Option<Fault> {
        // SplitMix64 of the number of the draw.
        let mut z = self.draws.fetch_add(1, Ordering::Relaxed).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let mut left = (z ^ (z >> 31)) % 100;
        for (fault, name, share) in FAULTS {
            if left < share {
                let fits = match fault {
                    Fault::HalfUpload => !is_empty,
                    Fault::CutAnswer => method == "GET",
                    _ => true,
                };
                if fits {
                    *self.faults.lock().expect("no holder panics").entry(name).or_default() += 1;
                }
                return fits.then_some(fault);
            }
            left -= share;
        }
        None
    }
}

/// The head of a request with its empty line, and the body.
fn read_request(client: &mut TcpStream) -> io::Result<(String, Vec<u8>)> {
    const END: &[u8] = b"\r\n\r\n";
    let (mut bytes, mut buffer) = (Vec::new(), [0; 1 << 16]);
    let mut more = |bytes: &mut Vec<u8>| -> io::Result<()> {
        match client.read(&mut buffer)? {
            0 => Err(io::ErrorKind::UnexpectedEof.into()),
            n => {
                bytes.extend_from_slice(&buffer[..n]);
                Ok(())
            }
        }
    };
    let end = loop {
        if let Some(at) = bytes.windows(END.len()).position(|window| window == END) {
            break at + END.len();
        }
        more(&mut bytes)?;
    };
    let head = String::from_utf8_lossy(&bytes[..end]).into_owned();
    let length = head.lines().find_map(|line| {
        let (name, value) = line.split_once(':')?;
        name.eq_ignore_ascii_case("content-length").then(|| value.trim().parse::<usize>().ok())?
    });
    while bytes.len() < end + length.unwrap_or(0) {
        more(&mut bytes)?;
    }
    Ok((head, bytes.split_off(end)))
}

fn answer(client: &mut TcpStream, status: &str, code: &str) -> io::Result<()> {
    let body = format!("<Error><Code>{code}</Code><Message>try again</Message></Error>");
    let length = body.len();
    write!(client, "HTTP/1.1 {status}\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n{body}")?;
    client.shutdown(Shutdown::Both)
}

//! The process of one reader.

use crate::arguments::Arguments;
use crate::mutate::mutated;
use crate::random::Random;
use crate::readers::{READERS, Reader};
use crate::{MAX_FAILURES, failed, say};
use rustix::process::{Resource, Rlimit, setrlimit};
use std::fs::File;
use std::ops::Add;
use std::os::unix::fs::FileExt as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// The first argument of a child.
pub(crate) const MARK: &str = "--child";
/// Limit of a child's address space. The files have kilobytes, and an allocation beyond the limit
/// ends the process.
const MEMORY: u64 = 2 << 30;

/// The result of some runs.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Tally {
    pub(crate) runs: u64,
    /// Files that were read without an error although they were mutated.
    pub(crate) sound: u64,
    pub(crate) failures: u64,
    pub(crate) seconds: f64,
}

impl Add for Tally {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            runs: self.runs + other.runs,
            sound: self.sound + other.sound,
            failures: self.failures + other.failures,
            seconds: self.seconds + other.seconds,
        }
    }
}

/// Runs the selected reader until its time is over.
pub(crate) fn run(arguments: &Arguments) -> ExitCode {
    let limit = Rlimit { current: Some(MEMORY), maximum: Some(MEMORY) };
    setrlimit(Resource::As, limit).unwrap();
    let progress = File::options().write(true).open(arguments.progress.as_ref().unwrap()).unwrap();
    let reader = READERS.iter().find(|reader| arguments.has(reader.name)).unwrap();
    let corpus = (reader.corpus)();
    assert!(!corpus.is_empty(), "{}: no corpus", reader.name);
    for (name, content) in &corpus {
        assert!((reader.read)(content), "{}: `{name}` of the corpus is not sound", reader.name);
    }
    let end = Instant::now() + Duration::from_secs(arguments.seconds);
    let mut tally = Tally::default();
    while Instant::now() < end
        && tally.failures < MAX_FAILURES
        && arguments.runs.is_none_or(|runs| tally.runs < runs)
    {
        let run = arguments.first + tally.runs;
        tally.runs += 1;
        // Recorded before the run begins, since the run may kill the process.
        say_progress(&progress, tally);
        let file = mutated(&corpus, &mut Random::new(arguments.seed, run));
        match one(reader, &file) {
            Ok(sound) => tally.sound += u64::from(sound),
            Err(what) => {
                tally.failures += 1;
                say(&failed(reader.name, arguments.seed, run, &what));
            }
        }
    }
    say_progress(&progress, tally);
    ExitCode::SUCCESS
}

/// Does one run. Returns true if the file was read, or the reason why the run failed.
fn one(reader: &Reader, file: &[u8]) -> Result<bool, String> {
    // Processor time, so that a busy machine causes no failure.
    let begin = processor_time();
    let sound = catch_unwind(AssertUnwindSafe(|| (reader.read)(file))).map_err(|_| "a panic, shown above")?;
    let took = processor_time().saturating_sub(begin);
    if took > reader.longest() {
        Err(format!("{:.1} s for {} bytes", took.as_secs_f64(), file.len()))
    } else {
        Ok(sound)
    }
}

/// Processor time of this process so far, all threads together.
fn processor_time() -> Duration {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Duration::try_from(time).expect("processor time is never negative")
}

fn say_progress(file: &File, tally: Tally) {
    let numbers = [tally.runs, tally.sound, tally.failures].map(u64::to_le_bytes);
    file.write_all_at(numbers.as_flattened(), 0).unwrap();
}

/// Reads the progress of a child.
pub(crate) fn progress(path: &Path) -> Tally {
    let bytes = std::fs::read(path).unwrap();
    let number =
        |k: usize| bytes.get(8 * k..8 * k + 8).map_or(0, |b| u64::from_le_bytes(b.try_into().unwrap()));
    Tally { runs: number(0), sound: number(1), failures: number(2), seconds: 0.0 }
}

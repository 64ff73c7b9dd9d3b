//! Speed of each part on this machine:
//! `cargo xtask bench [--json] [--runs N] [--only TEXT] [PART]…`.
//!
//! No result here passes or fails. Rates are given at the median and at the fastest of several
//! runs, with the workload; `RAYON_NUM_THREADS=1` gives the rates of one core.
#![expect(clippy::print_stdout, clippy::print_stderr, reason = "the figures are printed")]

mod growth;
mod laws;
mod measure;
mod training;
mod workloads;

use std::process::ExitCode;

struct Options {
    json: bool,
    runs: usize,
    /// Names of parts; empty for all.
    parts: Vec<String>,
    /// Texts that the name of every workload that runs must hold.
    only: Vec<String>,
}

fn main() -> ExitCode {
    let options = match parse(std::env::args().skip(1)) {
        Ok(options) => options,
        Err(why) => {
            eprintln!("error: {why}\nusage: cargo xtask bench [--json] [--runs N] [--only TEXT] [PART]...");
            return ExitCode::from(2);
        }
    };
    let wanted = |part: &str| options.parts.is_empty() || options.parts.iter().any(|name| name == part);
    let mut all = workloads::all(&wanted);
    all.retain(|work| options.only.iter().all(|text| work.what.contains(text)));
    let timings = measure::measure(all, options.runs);
    let growing = wanted(growth::PART).then(|| growth::measure(&options.only, options.runs));
    let growing = growing.unwrap_or_default();
    let (training, memory) = if wanted(training::PART) {
        (training::measure(options.runs), training::memory::measure())
    } else {
        (Vec::new(), Vec::new())
    };
    let threads = rayon::current_num_threads();
    if options.json {
        let parts: Vec<_> = timings.iter().map(measure::Timing::json).collect();
        let ratios = measure::ratios(&timings).into_iter();
        let ratios: Vec<_> = ratios
            .map(|(part, [median, best])| serde_json::json!({ "part": part, "median": median, "best": best }))
            .collect();
        let runs = options.runs;
        let growing: Vec<_> = growing.iter().map(growth::Axis::json).collect();
        let training: Vec<_> = training.iter().map(training::Axis::json).collect();
        let memory: Vec<_> = memory.iter().map(training::memory::MemoryPoint::json).collect();
        println!(
            "{}",
            serde_json::json!({
                "threads": threads, "runs": runs, "parts": parts, "ratios": ratios, "growth": growing,
                "training": training, "training_memory": memory,
            })
        );
        return ExitCode::SUCCESS;
    }
    println!("{} runs each after one to warm up, {threads} threads", options.runs);
    timings.iter().for_each(|timing| println!("{}", timing.lines()));
    for (part, [median, best]) in measure::ratios(&timings) {
        println!("{part}: {median:.2} of the rival's rate at the median, {best:.2} at the best");
    }
    println!("{}", measure::costs(&timings));
    growing.iter().for_each(|axis| println!("\n{}", axis.table()));
    training.iter().for_each(|axis| println!("\n{}", axis.table()));
    if !memory.is_empty() {
        println!("\n{}", training::memory::table(&memory));
    }
    ExitCode::SUCCESS
}

fn parse(args: impl Iterator<Item = String>) -> Result<Options, String> {
    let mut options = Options { json: false, runs: 7, parts: Vec::new(), only: Vec::new() };
    let mut args = args;
    while let Some(arg) = args.next() {
        match arg.as_str() {
            "--json" => options.json = true,
            // cargo passes this to every benchmark.
            "--bench" => {}
            "--runs" => options.runs = count(args.next().as_deref())?,
            "--only" => options.only.push(args.next().ok_or("found nothing after --only, wanted a text")?),
            part if workloads::PARTS.contains(&part) || [growth::PART, training::PART].contains(&part) => {
                options.parts.push(arg);
            }
            _ => {
                return Err(format!(
                    "found `{arg}`, wanted an option or one of {} {} {}",
                    workloads::PARTS.join(" "),
                    growth::PART,
                    training::PART
                ));
            }
        }
    }
    Ok(options)
}

fn count(text: Option<&str>) -> Result<usize, String> {
    let found = text.unwrap_or("nothing");
    found.parse().ok().filter(|n| *n > 0).ok_or(format!("found {found} after --runs, wanted a count above 0"))
}

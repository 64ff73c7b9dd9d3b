//! `gs2e study`, through the program. The library's tests compare its counts with planted truth.

use crate::support::absent::runs_slow_tests;
use crate::support::workspace::{TINY, Workspace};
use serde_json::Value;
use std::fs;

#[test]
fn thresholds_are_swept_over_a_built_scene() {
    let place = Workspace::with_tiny();
    let found = place.gs2e("study thresholds tiny.yaml");
    assert_eq!(found.code, 1, "{}", found.stderr);
    assert!(found.stderr.contains("tiny/capture is not built"), "{}", found.stderr);
    place.ok("build tiny.yaml");
    let sweep = "study thresholds tiny.yaml --span 0,5 --csv t.csv --picture t.png";
    let found = place.ok(sweep).stdout;
    assert!(found.starts_with("tiny/base: 12 frames, 4.6 ms, rendered with two rules"), "{found}");
    let (said, fragment) = found.split_once("For the recipe:\n").unwrap();
    assert!(said.lines().last().unwrap().starts_with("recommended: "), "{found}");
    place.write(
        "pasted.yaml",
        format!(
            "{}{fragment}",
            TINY.split_once("sensor:").unwrap().0.replace("scene: tiny", "scene: pasted")
        ),
    );
    place.ok("plan pasted.yaml");
    let table = fs::read_to_string(place.path("t.csv")).unwrap();
    let rows: Vec<Vec<f64>> =
        table.lines().skip(1).map(|row| row.split(',').map(|v| v.parse().unwrap()).collect()).collect();
    let thresholds: Vec<f64> = rows.iter().map(|row| row[0]).collect();
    assert_eq!(thresholds, [0.25, 0.5, 0.75, 1.0, 1.25, 1.5]);
    for row in &rows {
        let [events, smooth, near, other] = [row[2], row[6], row[7], row[8]];
        assert!((smooth + near + other - events).abs() < 0.5, "{row:?}");
    }
    assert!(rows.windows(2).all(|pair| pair[0][2] > pair[1][2]), "the lower the more");
    assert!(fs::read(place.path("t.png")).unwrap().starts_with(b"\x89PNG"));
    // The same numbers again as JSON; the store was not touched.
    let json: Value = serde_json::from_str(&place.ok(&format!("{sweep} --json")).stdout).unwrap();
    assert_eq!(json["rows"].as_array().unwrap().len(), 6);
    assert_eq!(json["rows"][0]["events"].as_f64(), Some(rows[0][2]));
    assert!(place.stale("tiny.yaml").is_empty());
}

#[test]
fn sweeps_see_through_the_front_end() {
    let place = Workspace::with_tiny();
    let events = |front_end: &str| {
        let sensor = format!("preset: dvs346, front_end: {front_end},");
        place.write("tiny.yaml", TINY.replace("preset: dvs346,", &sensor));
        place.ok("build tiny.yaml");
        let found = place.ok("study thresholds tiny.yaml --span 0,5 --thresholds 1 --json").stdout;
        let found: Value = serde_json::from_str(&found).unwrap();
        found["rows"][0]["events"].as_u64().unwrap()
    };
    let plain = events("{}");
    assert!(plain > 100, "{plain}");
    assert_eq!(events("{ exposure: 1, luminance: rec601 }"), plain);
    assert_ne!(events("{ decode: srgb }"), plain);
    // A clamped brightness does not change.
    let dark = events("{ range: { min: 254, max: 255 } }");
    assert!(dark < plain / 10, "{dark}");
}

#[test]
fn impossible_sweeps_are_refused() {
    let place = Workspace::with_tiny();
    place.ok("build tiny.yaml");
    let refused = |args: &str, wanted: &str| {
        let message = place.gs2e(&format!("study thresholds tiny.yaml {args}"));
        assert_eq!(message.code, 2, "{args}: {}", message.stderr);
        assert!(message.stderr.contains(wanted), "{args}: {}", message.stderr);
    };
    refused("--trajectory other", "tiny has no trajectory `other`; it has base");
    refused("--thresholds 1,0.5", "wanted increasing numbers");
    refused("--thresholds 0", "wanted increasing numbers");
    refused("--span 5,1", "is not T0,T1");
    refused("--span 1e6,2e6", "0 poses are from");
    refused("--csv nowhere/t.csv", "a folder that does not exist");
    place.write(
        "two.yaml",
        TINY.replace("voltmeter: { preset: dvs346, threshold: { on: 1.0, off: 1.0 } }", "v2e: {}"),
    );
    let message = place.gs2e("study thresholds two.yaml");
    assert_eq!(message.code, 2);
    assert!(message.stderr.contains("is v2e, wanted a voltmeter"), "{}", message.stderr);
}

/// One path, even and flow steps, two rule sets: the files of a study, and the required results.
#[test]
fn work_and_precision_of_a_built_scene() {
    let place = Workspace::new();
    let faster = [("arc: 6", "arc: 20"), ("factor: 2", "factor: 8"), ("gaussians: 500", "gaussians: 300")];
    place.write("tiny.yaml", faster.iter().fold(TINY.to_owned(), |text, (from, to)| text.replace(from, to)));
    place.ok("build tiny.yaml");
    let study = "study tiny.yaml --rates 600,1200,2400 --seconds 0.019";
    let found = place.ok(&format!("{study} --rules official,blended --to out")).stdout;
    assert!(found.starts_with("`official linear` at 2400 frames a second costs "), "{found}");
    let (lines, because) = found.split_once("For the recipe:\n").unwrap().1.split_once("because ").unwrap();
    assert!(because.contains("core-seconds"), "{because}");
    let [above, below] = TINY.split_once("sampling: { rate: 2400, between: linear }\n").unwrap().into();
    place.write("pasted.yaml", format!("{above}{lines}{below}").replace("scene: tiny", "scene: pasted"));
    place.ok("plan pasted.yaml");
    let table = fs::read_to_string(place.path("out/work_precision.csv")).unwrap();
    let mut lines = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let head = lines.next().unwrap();
    let rows: Vec<Vec<&str>> = lines.collect();
    // Two rule sets, two kinds of steps, three rates, three interpolations.
    assert_eq!(rows.len(), 36);
    let column = |name: &str| head.iter().position(|column| *column == name).unwrap();
    let value = |key: [&str; 4], name: &str| -> f64 {
        let row = rows.iter().find(|row| row[..4] == key).unwrap_or_else(|| panic!("no {key:?}"));
        row[column(name)].parse().unwrap()
    };
    for (rules, share) in [("official", 1.0), ("blended", 0.3)] {
        let of = |between, rate, name| value([rules, between, "uniform", rate], name);
        let [linear, hermite] = ["linear", "hermite"].map(|between| of(between, "2400", "median_us"));
        println!("{rules}: median {linear} us of linear, {hermite} us of hermite");
        // Where the picture is smooth in time, cubics reach their order; jumps prevent that.
        assert!(hermite < share * linear, "{rules}");
        for between in ["linear", "hermite"] {
            assert!(of(between, "2400", "median_us") < of(between, "600", "median_us"), "{rules} {between}");
            assert!(of(between, "2400", "rms_th") < of(between, "600", "rms_th"), "{rules} {between}");
        }
        let [few, many] = ["600", "2400"].map(|rate| of("linear", rate, "frames"));
        assert!((few - 13.0).abs() < 0.1 && (many - 47.0).abs() < 0.1, "{few} {many}");
        assert!(value([rules, "linear", "flow", "600"], "frames") <= few);
        let f1 = ["f1_10us", "f1_100us", "f1_1000us"].map(|name| of("hermite", "2400", name));
        assert!(f1[0] <= f1[1] && f1[1] <= f1[2] && f1[2] > 0.8, "{f1:?}");
    }
    for name in ["rms", "count", "miscount", "time_median", "time_p99", "f1"] {
        let svg = fs::read_to_string(place.path(&format!("out/{name}.svg"))).unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("blended hermite"), "{name}");
    }
    let words = fs::read_to_string(place.path("out/summary.md")).unwrap();
    assert!(words.contains("## Rule sets") && words.contains("| luminance in f64 |"), "{words}");
    told_in_short(&words, &head, &rows);
    let json: Value = place.json("out/work_precision.json");
    let [value, rated] = ["value", "rated"].map(|kind| json["rules"][0]["costs"][kind].clone());
    assert!(value["pairs"].as_f64() > Some(1000.0) && value["pairs"] == rated["pairs"], "{value} {rated}");
    let pictures = json["pictures"].as_array().unwrap();
    let in_32_bits = &pictures[0];
    assert_eq!(in_32_bits["what"], "luminance");
    assert!(in_32_bits["psnr_db"].as_f64() > Some(60.0), "{in_32_bits}");
    // The same stream with the sensor's noise, in the scene's own folder.
    let found =
        place.ok(&format!("{study} --noise --rules soft --steps uniform --no-pictures --json")).stdout;
    let json: Value = serde_json::from_str(&found).unwrap();
    assert_eq!(json["pictures"].as_array().map(Vec::len), Some(0));
    assert_eq!((json["noise"].as_bool(), json["rows"].as_array().unwrap().len()), (Some(true), 9));
    assert!(json["recommended"]["recipe"].as_str().unwrap().starts_with("sampling: "), "{json}");
    assert!(place.path("study/tiny/summary.md").is_file());
}

/// Compares the first sections of the summary with the table.
fn told_in_short(words: &str, head: &[&str], rows: &[Vec<&str>]) {
    let section = |head: &str| words.split("\n## ").find(|part| part.starts_with(head)).unwrap();
    let cheapest = section("The cheapest at the errors of `official linear`, 2400");
    assert!(cheapest.contains("| `official linear` itself | 47 | "), "{cheapest}");
    let lowest: Vec<&str> = section("The lowest errors").lines().collect();
    let column = head.iter().position(|column| *column == "rms_th").unwrap();
    let rms = |row: &&Vec<&str>| row[column].parse::<f64>().unwrap();
    for (number, rules) in ["official", "blended"].into_iter().enumerate() {
        // A row for each of four measures, and the row of the setting itself.
        let found = cheapest.matches(&format!("| `{rules} ")).count()
            + cheapest.matches(&format!("| `{rules}` does not reach it")).count();
        assert_eq!(found, 4 + usize::from(rules == "official"), "{cheapest}");
        let of_rules = rows.iter().filter(|row| row[0] == rules);
        let row = of_rules.min_by(|a, b| rms(a).total_cmp(&rms(b))).unwrap();
        let flow = if row[2] == "flow" { ", flow steps" } else { "" };
        let wanted = format!("| `{rules} {}{flow}`, {} frames a second | {} |", row[1], row[3], row[4]);
        assert!(lowest[6 + number].contains(&wanted), "{wanted} in {lowest:#?}");
    }
}

#[test]
fn impossible_studies_are_refused() {
    let place = Workspace::with_tiny();
    let refused = |args: &str, wanted: &str| {
        let message = place.gs2e(&format!("study tiny.yaml {args}"));
        assert_eq!(message.code, 2, "{args}: {}", message.stderr);
        assert!(message.stderr.contains(wanted), "{args}: {}", message.stderr);
    };
    refused("--rates 500", "--finest 9600 is not an even multiple of it");
    refused("--rates 600,300", "wanted increasing numbers");
    refused("--rules sharp", "invalid value 'sharp'");
    refused("--trajectory other", "tiny has no trajectory `other`");
    place.ok("build tiny.yaml");
    refused("--seconds 3", "extend beyond the end of the trajectory");
    refused("--rates 150 --seconds 0.003", "have fewer than two steps at 150 frames per second");
    refused("--start=-1", "must be at least 0");
}

/// A preset makes what it states and what was published, and the picture shows both.
#[test]
fn a_preset_is_studied() {
    if !runs_slow_tests() {
        return;
    }
    let place = Workspace::new();
    let ended = place.ok("study sensor davis346 --json --picture davis346.svg");
    let found: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert_eq!(found["passes"], true, "{found}");
    // Three lights, both polarities: ln 1.143 and -ln(1 - 0.225) of the camera's data.
    let rows = found["contrast"].as_array().unwrap();
    assert_eq!(rows.len(), 6);
    for row in rows {
        let wanted = if row["on"] == true { 0.133_656 } else { 0.254_892 };
        assert!((row["found"].as_f64().unwrap() / wanted - 1.0).abs() < 0.03, "{row}");
    }
    // The two published lights, and four between them.
    let noise = found["noise"]["rows"].as_array().unwrap();
    assert_eq!(noise.iter().filter(|row| row["anchor"].is_array()).count(), 2);
    let lux: Vec<f64> = noise.iter().map(|row| row["lux"].as_f64().unwrap()).collect();
    assert!(lux.len() == 6 && lux.windows(2).all(|pair| pair[0] < pair[1]), "{lux:?}");
    let svg = fs::read_to_string(place.path("davis346.svg")).unwrap();
    // A dot for each polarity and light, and the published rate of 0.
    assert_eq!(svg.matches("<circle").count(), 12);
    assert!(svg.contains("davis346: share of pixels") && svg.contains(">0 Hz<"), "{svg}");
}

//! Power of the checks on the files of releases: the share of planted faults that
//! `gs2e check --tree` finds, by size, and whether the stated power is right.
//!
//! `cargo xtask power` makes releases of many kinds and runs this example on them; it prints the
//! table of crates/lab/results/checks.md. `cargo run --release --example power -- RELEASE...` takes
//! other releases; `--stated` plants the faults of the stated sizes alone.
//! Faults are planted in copies. Only trajectories with sharp frames and events at every pose count;
//! without depth, the faults that it shows are left out.

#![expect(
    clippy::print_stdout,
    clippy::print_stderr,
    clippy::cast_possible_truncation,
    reason = "an example that prints tables of rounded numbers"
)]

use glam::{DQuat, DVec3};
use gs2e_audit::recheck::recheck_tree;
use gs2e_check::{Finding, Verdict};
use gs2e_event::h5::H5Options;
use gs2e_event::{Event, EventSink as _, EventSource as _, h5};
use gs2e_num::se3::Se3;
use gs2e_num::units::Timestamp;
use gs2e_trajectory::Trajectory;
use rayon::prelude::*;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

type Failure = Box<dyn Error + Send + Sync>;

/// Sizes of planted offsets, us.
const OFFSETS_US: [f64; 7] = [10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0];
/// Relative changes of both thresholds.
const THRESHOLDS: [f64; 5] = [0.01, 0.02, 0.05, 0.1, 0.2];
/// Shares of the events that are dropped at random.
const DROPPED_SHARES: [f64; 7] = [0.001, 0.003, 0.01, 0.03, 0.05, 0.1, 0.2];
/// Standard deviations of the noise of all poses, steps.
const NOISE: [f64; 5] = [0.01, 0.03, 0.1, 0.3, 1.0];
/// Planted excess of the translation.
const FACTORS: [f64; 4] = [0.03, 0.05, 0.1, 0.2];
/// Trials per trajectory and size, where chance has a part.
const TRIALS: u64 = 4;

fn main() -> Result<(), Failure> {
    let (flags, releases): (Vec<String>, Vec<String>) =
        std::env::args().skip(1).partition(|arg| arg.starts_with("--"));
    let stated_only = match flags.as_slice() {
        [] => false,
        [flag] if flag == "--stated" => true,
        _ => return Err(format!("found {}, wanted [--stated] RELEASE...", flags.join(" ")).into()),
    };
    let mut places = Vec::new();
    for release in releases.iter().map(Path::new) {
        for (scene, trajectory) in trajectories(release)? {
            places.push(TrajectoryCopy::new(release, &scene, &trajectory)?);
        }
    }
    let faults: Vec<Vec<PlantedFault>> = places
        .into_par_iter()
        .map(|place| PowerTrials::of_place(place, stated_only))
        .collect::<Result<_, _>>()?;
    print_table(&faults.into_iter().flatten().collect::<Vec<_>>());
    Ok(())
}

/// Scenes and trajectories of a release with events, by its scene.json files.
fn trajectories(release: &Path) -> Result<Vec<(String, String)>, Failure> {
    let manifest: serde_json::Value = serde_json::from_slice(&fs::read(release.join("manifest.json"))?)?;
    let mut found = Vec::new();
    for scene in manifest["scenes"].as_array().into_iter().flatten() {
        let id = scene["id"].as_str().ok_or("a scene without an id")?;
        let record: serde_json::Value =
            serde_json::from_slice(&fs::read(release.join(id).join("scene.json"))?)?;
        for part in record["trajectories"].as_array().into_iter().flatten() {
            let name = part["name"].as_str().ok_or("a trajectory without a name")?;
            if release.join(id).join(name).join("events.h5").exists() {
                found.push((id.to_owned(), name.to_owned()));
            }
        }
    }
    Ok(found)
}

/// One trajectory as a release of its own, in which files can be replaced.
struct TrajectoryCopy {
    folder: TempDir,
    id: String,
    name: String,
    source: PathBuf,
}

impl TrajectoryCopy {
    fn new(release: &Path, id: &str, name: &str) -> Result<Self, Failure> {
        let folder = tempfile::tempdir()?;
        let mut manifest: serde_json::Value =
            serde_json::from_slice(&fs::read(release.join("manifest.json"))?)?;
        let scenes = manifest["scenes"].as_array_mut().ok_or("a manifest without scenes")?;
        scenes.retain(|scene| scene["id"] == id);
        fs::write(folder.path().join("manifest.json"), serde_json::to_vec(&manifest)?)?;
        let mut record: serde_json::Value =
            serde_json::from_slice(&fs::read(release.join(id).join("scene.json"))?)?;
        let parts = record["trajectories"].as_array_mut().ok_or("a scene without trajectories")?;
        parts.retain(|part| part["name"] == name);
        let own = folder.path().join(id).join(name);
        fs::create_dir_all(&own)?;
        fs::write(folder.path().join(id).join("scene.json"), serde_json::to_vec(&record)?)?;
        let source = release.join(id).join(name);
        for file in ["poses.txt", "speed.json"] {
            fs::copy(source.join(file), own.join(file))?;
        }
        Ok(Self { folder, id: id.to_owned(), name: name.to_owned(), source })
    }

    fn path(&self, file: &str) -> PathBuf {
        self.folder.path().join(&self.id).join(&self.name).join(file)
    }

    /// Adds the pictures of a kind, or removes them.
    fn with_pictures(&self, kind: &str, wanted: bool) -> Result<(), Failure> {
        if !wanted {
            fs::remove_dir_all(self.path(kind))?;
            return Ok(());
        }
        fs::create_dir_all(self.path(kind))?;
        for entry in fs::read_dir(self.source.join(kind))? {
            let entry = entry?;
            fs::copy(entry.path(), self.path(kind).join(entry.file_name()))?;
        }
        Ok(())
    }

    fn poses(&self) -> Result<Trajectory, Failure> {
        Ok(Trajectory::read_poses(fs::read(self.source.join("poses.txt"))?.as_slice())?)
    }

    fn write_poses(&self, trajectory: &Trajectory) -> Result<(), Failure> {
        Ok(trajectory.write_poses(fs::File::create(self.path("poses.txt"))?)?)
    }

    fn events(&self) -> Result<Vec<Event>, Failure> {
        let mut reader = h5::Reader::open(&self.source.join("events.h5"))?;
        let (mut events, mut chunk): (Vec<Event>, _) = (Vec::new(), Vec::new());
        while reader.next_chunk(&mut chunk)? {
            events.extend_from_slice(&chunk);
        }
        Ok(events)
    }

    /// Replaces the stream.
    fn write_events(&self, mut events: Vec<Event>) -> Result<(), Failure> {
        let header = h5::Reader::open(&self.source.join("events.h5"))?.header();
        let header = header.ok_or("a stream without a header")?;
        let end = *self.poses()?.stamps_us.last().ok_or("no pose")?;
        events.sort_by_cached_key(Event::file_order);
        let mut writer = h5::Writer::create_as(&self.path("events.h5"), &header, H5Options::default())?;
        writer.append(&events)?;
        writer.finish(end)?;
        Ok(())
    }

    /// The stream of a release of the same scene in a folder next to this release.
    fn variant(&self, name: &str) -> PathBuf {
        let release = self.source.ancestors().nth(1 + Path::new(&self.id).components().count());
        let folder = release.unwrap_or(&self.source).with_file_name(name);
        folder.join(&self.id).join(&self.name).join("events.h5")
    }

    fn focal_length(&self) -> Result<f64, Failure> {
        let record: serde_json::Value =
            serde_json::from_slice(&fs::read(self.folder.path().join(&self.id).join("scene.json"))?)?;
        Ok(record["camera"]["fx"].as_f64().ok_or("a camera without fx")?)
    }

    fn check(&self) -> Result<Vec<Finding>, Failure> {
        Ok(recheck_tree(self.folder.path(), &[])?.measured)
    }
}

fn part<'a>(findings: &'a [Finding], check: &str, part: &str) -> Option<&'a Finding> {
    let is_part = |f: &&Finding| f.subject.statement == part;
    findings.iter().filter(|f| f.check == check).find(is_part)
}

fn stated(findings: &[Finding], check: &str, name: &str) -> Option<f64> {
    Some(part(findings, check, name)?.detects.as_ref()?.size)
}

/// Returns true if a pass fails. The counts in scene.json find every dropped event; they do not count.
fn any_found(findings: &[Finding]) -> bool {
    findings.iter().any(|f| f.verdict == Verdict::Fail && f.check != "records")
}

fn is_found(findings: &[Finding], check: &str, name: &str) -> bool {
    part(findings, check, name).is_some_and(|f| f.verdict == Verdict::Fail)
}

/// A planted fault of one kind.
struct PlantedFault {
    /// Index into [`FAULTS`].
    kind: usize,
    size: FaultSize,
    found: bool,
}

/// Size of a planted fault.
#[derive(Clone, Copy, PartialEq)]
enum FaultSize {
    /// No fault.
    Sound,
    /// A size from the tables above.
    Fixed(f64),
    /// The size that the pass states for this stream.
    Stated(f64),
}

use FaultSize::{Fixed, Sound, Stated};

/// Kinds of faults, with their units.
const FAULTS: [(&str, &str); 10] = [
    ("events earlier or later", "us"),
    ("events earlier or later, by `time_offset` alone", "us"),
    ("clock of the events faster or slower", "1"),
    ("thresholds lower or higher", "1"),
    ("share of the events dropped", "1"),
    ("noise of all poses", "steps"),
    ("one pose displaced", "steps"),
    ("translation too large, from frames and depth alone", "1"),
    ("slow turn, from frames and depth alone", "px"),
    ("one pose turned, from frames and depth alone", "px"),
];
const OFFSET: usize = 0;
const FRAME_OFFSET: usize = 1;
const CLOCK: usize = 2;
const THRESHOLD: usize = 3;
const DROPPED: usize = 4;
const NOISY: usize = 5;
const DISPLACED: usize = 6;
const FACTOR: usize = 7;
const SLOW_TURN: usize = 8;
const ONE_TURN: usize = 9;

/// The trials of one trajectory.
struct PowerTrials {
    place: TrajectoryCopy,
    /// True if only faults of the stated sizes are planted.
    stated_only: bool,
    faults: Vec<PlantedFault>,
}

impl PowerTrials {
    fn of_place(place: TrajectoryCopy, stated_only: bool) -> Result<Vec<PlantedFault>, Failure> {
        let mut trials = Self { place, stated_only, faults: Vec::new() };
        trials.measure_poses()?;
        trials.place.with_pictures("sharp", true)?;
        trials.measure_events()?;
        if trials.place.source.join("depth").exists() {
            trials.place.with_pictures("depth", true)?;
            trials.measure_pictures()?;
        }
        Ok(trials.faults)
    }

    /// These sizes, unless only the stated ones are planted.
    fn fixed<const N: usize>(&self, sizes: [f64; N]) -> impl Iterator<Item = f64> + use<N> {
        let count = if self.stated_only { 0 } else { N };
        sizes.into_iter().take(count)
    }

    fn add(&mut self, kind: usize, size: FaultSize, found: bool) {
        let name = FAULTS[kind].0;
        match size {
            Stated(size) if !found => {
                eprintln!("{}/{}: {name} by {size:.3e}: missed", self.place.id, self.place.name);
            }
            Sound if found => eprintln!("{}/{}: {name}: false alarm", self.place.id, self.place.name),
            _ => {}
        }
        self.faults.push(PlantedFault { kind, size, found });
    }

    fn measure_poses(&mut self) -> Result<(), Failure> {
        const PART: &str = "noise-translation";
        let (sound, clean) = (self.place.check()?, self.place.poses()?);
        let Some(detects) = stated(&sound, "pose_continuity", PART) else { return Ok(()) };
        self.add(NOISY, Sound, is_found(&sound, "pose_continuity", PART));
        let speed: serde_json::Value = serde_json::from_slice(&fs::read(self.place.path("speed.json"))?)?;
        // Steps are those of the mixed metric, as a distance.
        let step = mixed_step(&clean.world_from_camera, speed["scale_distance"].as_f64().unwrap_or(1.0));
        let mut draws = Draws(7);
        for size in self.fixed(NOISE) {
            for _ in 0..TRIALS {
                let findings = self.with_poses(&clean, |_, pose| {
                    pose.translation += size * step * draws.normal();
                })?;
                self.add(NOISY, Fixed(size), is_found(&findings, "pose_continuity", PART));
            }
        }
        for _ in 0..4 * TRIALS {
            let displaced = 5 + draws.below(clean.world_from_camera.len() - 10);
            let shift = detects * step * draws.normal().normalize();
            let findings = self.with_poses(&clean, |j, pose| {
                if j == displaced {
                    pose.translation += shift;
                }
            })?;
            self.add(DISPLACED, Stated(detects), is_found(&findings, "pose_continuity", PART));
        }
        self.place.write_poses(&clean)
    }

    /// The findings on the trajectory with changed poses.
    fn with_poses(
        &self,
        clean: &Trajectory,
        mut change: impl FnMut(usize, &mut Se3),
    ) -> Result<Vec<Finding>, Failure> {
        let mut trajectory = clean.clone();
        trajectory.world_from_camera.iter_mut().enumerate().for_each(|(j, pose)| change(j, pose));
        self.place.write_poses(&trajectory)?;
        self.place.check()
    }

    fn measure_events(&mut self) -> Result<(), Failure> {
        let events = self.place.events()?;
        self.place.write_events(events.clone())?;
        let sound = self.place.check()?;
        for (kind, check, part) in [
            (OFFSET, "event_times", "offset"),
            (CLOCK, "event_times", "scale"),
            (FRAME_OFFSET, "time_offset", ""),
        ] {
            let Some(detects) = stated(&sound, check, part) else { continue };
            self.add(kind, Sound, is_found(&sound, check, part));
            for sign in [1.0, -1.0] {
                let findings = self.with_times(&events, |t| {
                    // Away from 0, because times are whole microseconds.
                    if kind == CLOCK { (1.0 + sign * detects) * t } else { t + sign * detects.ceil() }
                })?;
                self.add(kind, Stated(detects), is_found(&findings, check, part));
            }
        }
        for size in self.fixed(OFFSETS_US) {
            for sign in [1.0, -1.0] {
                let findings = self.with_times(&events, |t| t + sign * size)?;
                self.add(OFFSET, Fixed(size), any_found(&findings));
            }
        }
        let mut draws = Draws(11);
        for share in self.fixed(DROPPED_SHARES) {
            for _ in 0..2 {
                let kept = events.iter().filter(|_| draws.uniform() >= share);
                self.place.write_events(kept.copied().collect())?;
                self.add(DROPPED, Fixed(share), any_found(&self.place.check()?));
            }
        }
        self.measure_thresholds()?;
        Ok(fs::remove_file(self.place.path("events.h5"))?)
    }

    /// The findings on the stream with other times. Events outside of the clip are lost.
    fn with_times(&self, events: &[Event], time: impl Fn(f64) -> f64) -> Result<Vec<Finding>, Failure> {
        let end = *self.place.poses()?.stamps_us.last().ok_or("no pose")?;
        let moved = events.iter().filter_map(|event| {
            let t_us = time(event.t.floor_micros() as f64).round() as i64;
            (0..=end).contains(&t_us).then(|| Event { t: Timestamp::from_micros(t_us), ..*event })
        });
        self.place.write_events(moved.collect())?;
        self.place.check()
    }

    /// Streams of other thresholds, which `cargo xtask power` makes from the same scene.
    fn measure_thresholds(&mut self) -> Result<(), Failure> {
        for size in self.fixed(THRESHOLDS) {
            for sign in ["-", "+"] {
                let variant = self.place.variant(&format!("threshold{sign}{size}"));
                if variant.exists() {
                    fs::copy(variant, self.place.path("events.h5"))?;
                    self.add(THRESHOLD, Fixed(size), any_found(&self.place.check()?));
                }
            }
        }
        Ok(())
    }

    fn measure_pictures(&mut self) -> Result<(), Failure> {
        let (sound, clean) = (self.place.check()?, self.place.poses()?);
        let Some(motion) = part(&sound, "photometric", "motion").filter(|f| f.detects.is_some()) else {
            return Ok(());
        };
        let detects = motion.detects.as_ref().map_or(0.0, |d| d.size);
        let apart: f64 = motion
            .because
            .split(' ')
            .find_map(|word| word.parse().ok())
            .ok_or("the pass states no distance")?;
        self.add(SLOW_TURN, Sound, any_found(&sound));
        for factor in self.fixed(FACTORS) {
            let findings = self.with_poses(&clean, |_, pose| pose.translation *= 1.0 + factor)?;
            self.add(FACTOR, Fixed(factor), is_found(&findings, "photometric", "motion"));
        }
        let focal = self.place.focal_length()?;
        // A turn moves the picture by at least the focal length times its angle.
        for axis in [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y] {
            let turn = detects / focal / apart;
            let findings = self.with_poses(&clean, |j, pose| {
                pose.rotation *= DQuat::from_axis_angle(axis, turn * j as f64);
            })?;
            self.add(SLOW_TURN, Stated(detects), is_found(&findings, "photometric", "motion"));
        }
        self.measure_one_turn(&sound, &clean, focal)?;
        self.place.write_poses(&clean)
    }

    fn measure_one_turn(&mut self, sound: &[Finding], clean: &Trajectory, focal: f64) -> Result<(), Failure> {
        let Some(detects) = stated(sound, "photometric", "frames") else { return Ok(()) };
        let mut draws = Draws(13);
        for axis in [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y] {
            let turned = 1 + draws.below(clean.world_from_camera.len() - 2);
            let findings = self.with_poses(clean, |j, pose| {
                if j == turned {
                    pose.rotation *= DQuat::from_axis_angle(axis, detects / focal);
                }
            })?;
            self.add(ONE_TURN, Stated(detects), is_found(&findings, "photometric", "frames"));
        }
        Ok(())
    }
}

/// Prints the share found of each kind and size, and the median of stated sizes.
fn print_table(faults: &[PlantedFault]) {
    println!("| fault | size | found | trials |\n|---|---|---|---|");
    for (kind, (name, unit)) in FAULTS.iter().enumerate() {
        let own: Vec<&PlantedFault> = faults.iter().filter(|fault| fault.kind == kind).collect();
        let row = |size: String, of: &dyn Fn(FaultSize) -> bool| {
            let found: Vec<bool> = own.iter().filter(|f| of(f.size)).map(|f| f.found).collect();
            if !found.is_empty() {
                let share = found.iter().filter(|found| **found).count() as f64 / found.len() as f64;
                println!("| {name} | {size} | {:.0} % | {} |", 100.0 * share, found.len());
            }
        };
        row("none".to_owned(), &|size| size == Sound);
        let mut sizes: Vec<f64> =
            own.iter().filter_map(|f| if let Fixed(size) = f.size { Some(size) } else { None }).collect();
        sizes.sort_unstable_by(f64::total_cmp);
        sizes.dedup();
        for fixed in sizes {
            row(format!("{fixed} {unit}"), &|size| size == Fixed(fixed));
        }
        let mut powers: Vec<f64> =
            own.iter().filter_map(|f| if let Stated(size) = f.size { Some(size) } else { None }).collect();
        powers.sort_unstable_by(f64::total_cmp);
        if let Some(median) = powers.get(powers.len() / 2) {
            row(format!("as stated (median {median:.2e} {unit})"), &|size| matches!(size, Stated(_)));
        }
    }
}

/// The median step in the mixed metric, as a distance.
fn mixed_step(poses: &[Se3], scale: f64) -> f64 {
    let step = |w: &[Se3]| {
        let turn = 2.0 * w[0].rotation.dot(w[1].rotation).abs().min(1.0).acos();
        (w[1].translation - w[0].translation).length() + scale * turn
    };
    let mut steps: Vec<f64> = poses.windows(2).map(step).collect();
    steps.sort_unstable_by(f64::total_cmp);
    steps[steps.len() / 2]
}

/// Random numbers (splitmix64).
struct Draws(u64);

impl Draws {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number from 0 to below 1.
    fn uniform(&mut self) -> f64 {
        (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    /// Three normal numbers of variance 1, each a sum of twelve even ones.
    fn normal(&mut self) -> DVec3 {
        let mut one = || (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0;
        DVec3::new(one(), one(), one())
    }
}

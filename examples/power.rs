//! Power of the checks on the files of releases: the share of planted faults that
//! `gs2e check --tree` finds, by size, and whether the stated power is right.
//!
//! `cargo run --release --example power -- RELEASE...` prints the tables of docs/checks.md. Faults are
//! planted in copies. Only trajectories with sharp frames, depth and events at every pose count.

#![expect(
    clippy::print_stdout,
    clippy::print_stderr,
    clippy::cast_possible_truncation,
    reason = "an example that prints tables of rounded numbers"
)]

use glam::{DQuat, DVec3};
use gs2e::check::{Finding, Verdict};
use gs2e::event::h5::{self, H5Options};
use gs2e::event::{Event, EventSink as _, EventSource as _};
use gs2e::release::recheck::recheck_tree;
use gs2e::se3::Se3;
use gs2e::trajectory::Trajectory;
use gs2e::units::Timestamp;
use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

type Failure = Box<dyn Error>;

/// Sizes of planted offsets, us.
const OFFSETS_US: [i64; 8] = [5, 10, 20, 50, 100, 200, 500, 1000];
/// Sizes of planted noise of all poses, steps.
const NOISE: [f64; 7] = [0.003, 0.01, 0.03, 0.1, 0.3, 0.5, 1.0];
/// Planted factors of the translation.
const FACTORS: [f64; 6] = [1.01, 1.02, 1.03, 1.05, 1.1, 1.2];
/// Trials per trajectory and size, where chance has a part.
const TRIALS: u64 = 8;

fn main() -> Result<(), Failure> {
    let releases: Vec<PathBuf> = std::env::args().skip(1).map(PathBuf::from).collect();
    let mut tables = PowerTables::default();
    for release in &releases {
        for (scene, trajectory) in trajectories(release)? {
            let place = TrajectoryCopy::new(release, &scene, &trajectory)?;
            tables.measure(&place)?;
            eprintln!("{scene}/{trajectory}");
        }
    }
    tables.print();
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

    /// Writes the events with other times. Those outside of the clip are lost.
    fn write_events(&self, time: impl Fn(i64) -> i64) -> Result<(), Failure> {
        let mut reader = h5::Reader::open(&self.source.join("events.h5"))?;
        let header = reader.header().ok_or("a stream without a header")?;
        let (mut events, mut chunk): (Vec<Event>, _) = (Vec::new(), Vec::new());
        while reader.next_chunk(&mut chunk)? {
            events.extend_from_slice(&chunk);
        }
        let end = *self.poses()?.stamps_us.last().ok_or("no pose")?;
        events.iter_mut().for_each(|e| e.t = Timestamp::from_micros(time(e.t.floor_micros())));
        events.retain(|event| (0..=end).contains(&event.t.floor_micros()));
        events.sort_by_cached_key(Event::file_order);
        let mut writer = h5::Writer::create_as(&self.path("events.h5"), &header, H5Options::default())?;
        writer.append(&events)?;
        writer.finish(end)?;
        Ok(())
    }

    fn check(&self) -> Result<Vec<Finding>, Failure> {
        Ok(recheck_tree(self.folder.path(), &[])?)
    }
}

fn part<'a>(findings: &'a [Finding], check: &str, part: &str) -> Option<&'a Finding> {
    findings.iter().find(|f| f.check == check && f.subject.statement == part)
}

fn is_found(findings: &[Finding], check: &str, name: &str) -> bool {
    part(findings, check, name).is_some_and(|f| f.verdict == Verdict::Fail)
}

/// Number of faults found, and of those planted.
#[derive(Default, Clone, Copy)]
struct Share([u64; 2]);

impl Share {
    fn add(&mut self, found: bool) {
        self.0[0] += u64::from(found);
        self.0[1] += 1;
    }
}

/// Results over all trajectories.
#[derive(Default)]
struct PowerTables {
    sound: Share,
    offsets: [Share; OFFSETS_US.len()],
    noise: [Share; NOISE.len()],
    factors: [Share; FACTORS.len()],
    /// Faults of the stated size: offset, scale, one pose, relative pose.
    stated: [Share; 4],
    powers: [Vec<f64>; 4],
}

impl PowerTables {
    fn measure(&mut self, place: &TrajectoryCopy) -> Result<(), Failure> {
        self.measure_poses(place)?;
        place.with_pictures("sharp", true)?;
        self.measure_clock(place)?;
        place.with_pictures("depth", true)?;
        self.measure_pictures(place)?;
        Ok(())
    }

    fn measure_poses(&mut self, place: &TrajectoryCopy) -> Result<(), Failure> {
        const PART: &str = "noise-translation";
        let (sound, clean) = (place.check()?, place.poses()?);
        let Some(detects) = part(&sound, "pose_continuity", PART).and_then(|f| f.detects.clone()) else {
            return Ok(());
        };
        self.sound.add(is_found(&sound, "pose_continuity", PART));
        self.powers[2].push(detects.size);
        let speed: serde_json::Value = serde_json::from_slice(&fs::read(place.path("speed.json"))?)?;
        // Steps are those of the mixed metric, as a distance.
        let step = mixed_step(&clean.world_from_camera, speed["scale_distance"].as_f64().unwrap_or(1.0));
        let mut draws = Draws(7);
        let plant = |change: &mut dyn FnMut(&mut Vec<Se3>)| -> Result<bool, Failure> {
            let mut trajectory = clean.clone();
            change(&mut trajectory.world_from_camera);
            place.write_poses(&trajectory)?;
            Ok(is_found(&place.check()?, "pose_continuity", PART))
        };
        for (size, share) in NOISE.iter().zip(&mut self.noise) {
            for _ in 0..TRIALS {
                share.add(plant(&mut |poses| {
                    poses.iter_mut().for_each(|pose| pose.translation += size * step * draws.normal());
                })?);
            }
        }
        let inner = clean.world_from_camera.len() - 10;
        for _ in 0..4 * TRIALS {
            let pose = 5 + draws.below(inner);
            let shift = detects.size * step * draws.normal().normalize();
            self.stated[2].add(plant(&mut |poses| poses[pose].translation += shift)?);
        }
        place.write_poses(&clean)
    }

    fn measure_clock(&mut self, place: &TrajectoryCopy) -> Result<(), Failure> {
        place.write_events(|t| t)?;
        let sound = place.check()?;
        let stated = |name| part(&sound, "event_times", name).and_then(|f| f.detects.clone());
        let (Some(offset), Some(scale)) = (stated("offset"), stated("scale")) else { return Ok(()) };
        self.sound.add(is_found(&sound, "event_times", "offset") || is_found(&sound, "event_times", "scale"));
        self.powers[0].push(offset.size);
        self.powers[1].push(scale.size);
        for (size, share) in OFFSETS_US.iter().zip(&mut self.offsets) {
            for late in [*size, -size] {
                place.write_events(|t| t + late)?;
                share.add(is_found(&place.check()?, "event_times", "offset"));
            }
        }
        for sign in [1.0, -1.0] {
            // Away from 0, because times are whole microseconds.
            place.write_events(|t| t + sign as i64 * offset.size.ceil() as i64)?;
            self.stated[0].add(is_found(&place.check()?, "event_times", "offset"));
            place.write_events(|t| ((1.0 + sign * scale.size) * t as f64).round() as i64)?;
            self.stated[1].add(is_found(&place.check()?, "event_times", "scale"));
        }
        fs::remove_file(place.path("events.h5"))?;
        Ok(())
    }

    fn measure_pictures(&mut self, place: &TrajectoryCopy) -> Result<(), Failure> {
        let (sound, clean) = (place.check()?, place.poses()?);
        let Some(motion) = part(&sound, "photometric", "motion").filter(|f| f.detects.is_some()) else {
            return Ok(());
        };
        self.sound.add(sound.iter().any(|f| f.verdict == Verdict::Fail));
        let detects = motion.detects.as_ref().map_or(0.0, |d| d.size);
        self.powers[3].push(detects);
        let apart: f64 = motion
            .because
            .split(' ')
            .find_map(|word| word.parse().ok())
            .ok_or("the pass states no distance")?;
        let record: serde_json::Value =
            serde_json::from_slice(&fs::read(place.folder.path().join(&place.id).join("scene.json"))?)?;
        let focal = record["camera"]["fx"].as_f64().ok_or("a camera without fx")?;
        let plant = |change: &dyn Fn(usize, &mut Se3)| -> Result<bool, Failure> {
            let mut trajectory = clean.clone();
            trajectory.world_from_camera.iter_mut().enumerate().for_each(|(j, pose)| change(j, pose));
            place.write_poses(&trajectory)?;
            Ok(is_found(&place.check()?, "photometric", "motion"))
        };
        for (factor, share) in FACTORS.iter().zip(&mut self.factors) {
            share.add(plant(&|_, pose| pose.translation *= *factor)?);
        }
        // A slow turn moves the picture by at least the focal length times its angle.
        for axis in [DVec3::X, -DVec3::X, DVec3::Y, -DVec3::Y] {
            let turn = detects / focal / apart;
            let found = plant(&|j, pose| pose.rotation *= DQuat::from_axis_angle(axis, turn * j as f64))?;
            self.stated[3].add(found);
        }
        place.write_poses(&clean)
    }

    fn print(&self) {
        let row = |name: String, share: Share| {
            if share.0[1] > 0 {
                let percent = 100.0 * share.0[0] as f64 / share.0[1] as f64;
                println!("| {name} | {percent:.0} % | {} |", share.0[1]);
            }
        };
        let head = |name: &str| println!("\n| {name} | found | trials |\n|---|---|---|");
        head("fault");
        row("none".to_owned(), self.sound);
        OFFSETS_US
            .iter()
            .zip(self.offsets)
            .for_each(|(size, share)| row(format!("offset of {size} us"), share));
        NOISE.iter().zip(self.noise).for_each(|(size, share)| row(format!("noise of {size} steps"), share));
        FACTORS
            .iter()
            .zip(self.factors)
            .for_each(|(size, share)| row(format!("translation times {size}"), share));
        println!(
            "\n| fault of the stated size | unit | median size | found | trials |\n|---|---|---|---|---|"
        );
        let names = [
            ("`event_times#offset`", "us"),
            ("`event_times#scale`", "1"),
            ("`pose_continuity#noise-translation`, one pose", "steps"),
            ("`photometric#motion`", "px"),
        ];
        for (((name, unit), share), powers) in names.into_iter().zip(self.stated).zip(&self.powers) {
            let mut powers = powers.clone();
            powers.sort_unstable_by(f64::total_cmp);
            let Some(median) = powers.get(powers.len() / 2) else { continue };
            let percent = 100.0 * share.0[0] as f64 / share.0[1].max(1) as f64;
            println!("| {name} | {unit} | {median:.2e} | {percent:.0} % | {} |", share.0[1]);
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

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    /// Three normal numbers of variance 1, each a sum of twelve even ones.
    fn normal(&mut self) -> DVec3 {
        let mut one = || (0..12).map(|_| self.next() as f64 / u64::MAX as f64).sum::<f64>() - 6.0;
        DVec3::new(one(), one(), one())
    }
}

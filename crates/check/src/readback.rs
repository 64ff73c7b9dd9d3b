//! Released files as other programs read them: events and `ms_to_idx` by h5py and numpy, pictures
//! by OpenCV. A gate: each must read exactly the same values. The pass runs if the recipe requests
//! it.

use super::subject::{Judgement, JudgementResult, Statements};
use super::{TrajectorySubject, ValidationPass, limits};
use gs2e_source::foreign;
use serde::{Deserialize, Serialize};

/// No limits: the key alone requests the pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {}

/// The pass.
pub(crate) struct ReadbackPass;

impl ValidationPass for ReadbackPass {
    fn of_trajectory(&self, subject: &TrajectorySubject<'_>) -> Result<Statements, String> {
        let read = subject.foreign.and_then(|foreign| foreign.readback.as_ref());
        let read = read.ok_or_else(|| limits::not_asked("readback"))?.as_ref()?;
        Ok(vec![
            ("events", judge_events(read)),
            ("index", judge_index(read)),
            ("pictures", judge_pictures(read)),
        ])
    }
}

const NO_EVENTS: &str = "there are no events";

fn judge_events(read: &foreign::readback::ReadbackReport) -> JudgementResult {
    if read.streams.is_empty() {
        return Err(NO_EVENTS.into());
    }
    let differing: usize = read.streams.iter().map(|stream| stream.differing.len()).sum();
    let total: u64 = read.streams.iter().map(|stream| stream.events).sum();
    let mut names: Vec<&str> =
        read.streams.iter().flat_map(|stream| &stream.differing).map(String::as_str).collect();
    // Several streams may differ in columns of one name.
    names.sort_unstable();
    names.dedup();
    let program = &read.program;
    let because = if names.is_empty() {
        format!("{program} reads {total} events in {} file(s) bit-exactly", read.streams.len())
    } else {
        format!("{program} reads different values of {}", names.join(", "))
    };
    Ok(Judgement::none_of(differing as f64, "1", because))
}

fn judge_index(read: &foreign::readback::ReadbackReport) -> JudgementResult {
    if read.streams.is_empty() {
        return Err(NO_EVENTS.into());
    }
    let sum = |value: fn(&foreign::readback::StreamRead) -> u64| read.streams.iter().map(value).sum::<u64>();
    let (entries, wrong) = (sum(|s| s.entries), sum(|s| s.wrong_entries));
    let because = format!("{wrong} of {entries} entries of ms_to_idx differ when read by {}", read.program);
    Ok(Judgement::none_of(wrong as f64, "1", because))
}

fn judge_pictures(read: &foreign::readback::ReadbackReport) -> JudgementResult {
    let pictures = read.pictures.as_ref()?;
    let differing = &pictures.differing;
    let first = differing.first().map_or_else(String::new, |pose| format!(", the first of pose {pose}"));
    let because = format!(
        "{} of {} pictures have different pixels when read by {}{first}",
        differing.len(),
        pictures.count,
        read.program
    );
    Ok(Judgement::none_of(differing.len() as f64, "1", because))
}

#[cfg(test)]
mod tests {
    use super::super::Verdict;
    use super::super::planted::PlantedWorld;
    use super::*;

    #[test]
    fn what_others_read_otherwise_is_found() {
        let t = |plant: fn(&mut foreign::readback::ReadbackReport), wanted: &str, says: &str| {
            let mut world = PlantedWorld::default_world();
            plant(world.foreign.readback.as_mut().unwrap().as_mut().unwrap());
            assert_eq!(world.faults(), [wanted]);
            let because = world.finding(wanted).because;
            assert!(because.contains(says), "{because}");
        };
        t(
            |r| r.streams[0].differing = vec!["p".into(), "t".into()],
            "readback#events",
            "different values of p, t",
        );
        t(|r| r.streams[0].wrong_entries = 1, "readback#index", "1 of 64 entries");
        t(
            |r| r.pictures.as_mut().unwrap().differing = vec![12, 13],
            "readback#pictures",
            "the first of pose 12",
        );
    }

    #[test]
    fn what_is_not_there_is_not_read() {
        let mut world = PlantedWorld::default_world();
        let read = world.foreign.readback.as_mut().unwrap().as_mut().unwrap();
        read.streams.clear();
        read.pictures = Err("there are no pictures".into());
        for statement in ["events", "index", "pictures"] {
            assert_eq!(
                world.finding(&format!("readback#{statement}")).verdict,
                Verdict::NotRun,
                "{statement}"
            );
        }
    }
}

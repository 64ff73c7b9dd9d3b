//! The row of the table in which an input is edited while its step reads it. The input is a named pipe: what it holds is
//! decided when it is opened, so the edit falls between the engine's hash and the step's own reading each time.

use super::{Workspace, made, recipe, stands_as_if_clean, steps};
use crate::support::given::{ply, transforms};
use crate::support::pipe::renew;
use rustix::fs::{Mode, OFlags, open};
use serde_json::json;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

/// Serves a pipe: `before` to whoever opens it while no step is at work, `after` from the first step on.
struct Served {
    pipe: PathBuf,
    done: Arc<AtomicBool>,
    thread: Option<JoinHandle<[usize; 2]>>,
}

impl Served {
    fn new(pipe: &Path, tmp: PathBuf, contents: [Vec<u8>; 2]) -> Self {
        renew(pipe);
        let done = Arc::new(AtomicBool::new(false));
        let (path, stop) = (pipe.to_owned(), done.clone());
        let thread = std::thread::spawn(move || {
            let mut times = [0, 0];
            while !stop.load(Ordering::SeqCst) {
                // Waits for a reader.
                let mut file = File::options().write(true).open(&path).unwrap();
                if stop.load(Ordering::SeqCst) {
                    break;
                }
                let is_at_work = fs::read_dir(&tmp).is_ok_and(|mut entries| entries.next().is_some());
                // A reader that closes early has read what it wanted.
                let _ = file.write_all(&contents[usize::from(is_at_work)]);
                times[usize::from(is_at_work)] += 1;
                renew(&path);
            }
            times
        });
        Self { pipe: pipe.to_owned(), done, thread: Some(thread) }
    }

    /// How often each content was read.
    fn close(mut self) -> [usize; 2] {
        self.done.store(true, Ordering::SeqCst);
        let reader = open(&self.pipe, OFlags::RDONLY | OFlags::NONBLOCK, Mode::empty()).unwrap();
        let times = self.thread.take().unwrap().join().unwrap();
        drop(reader);
        times
    }
}

#[test]
fn an_input_is_edited_while_its_step_reads_it() {
    let place = Workspace::new();
    let mut over_files = recipe("d");
    over_files["source"] = json!({ "nerfstudio": { "path": "transforms.json" } });
    over_files["reconstruct"] = json!({ "given": { "path": "scene.ply" } });
    over_files["outputs"] = json!([]);
    place.write("recipes/d.yaml", over_files.to_string());
    place.write("recipes/transforms.json", transforms(1.0));
    let [first, second, third] = [0.0, 1.0, 2.0].map(|shift| ply(|_, value| value + shift));
    place.write("recipes/scene.ply", &first);
    assert_eq!(made(&place).len(), 6);

    let path = place.path("recipes/scene.ply");
    fs::remove_file(&path).unwrap();
    let served = Served::new(&path, place.path(".gs2e/tmp"), [second, third.clone()]);
    let ended = place.gs2e("build");
    let times = served.close();
    assert!(times[0] >= 1 && times[1] >= 1, "it was hashed and read: {times:?}");
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    assert!(ended.stderr.contains("changed while it was read; nothing was recorded"), "{}", ended.stderr);

    fs::remove_file(&path).unwrap();
    place.write("recipes/scene.ply", third);
    let plan = steps(&place, "recipes");
    assert_eq!(plan["d/reconstruct"].action, "run", "{plan:?}");
    // Without photos it is held against nothing, but whoever holds it must look again.
    assert_eq!(made(&place), ["d/fidelity", "d/reconstruct"]);
    stands_as_if_clean(&place);
}

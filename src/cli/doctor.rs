//! `gs2e doctor`: the machine as the program sees it, for a report of an error.

mod trial;

use super::{BackendArg, CommonArgs, Console, ExitKind, VerbError, machine};
use fearless_simd::Level;
use gs2e_files::is_there;
use gs2e_files::programs::ProgramFinder;
use gs2e_gpu::{self as gpu, FeatureSet, GpuFeature, ListedGpu};
use gs2e_num::units::format_amount;
use gs2e_render::backend::Backend;
use gs2e_store::space::DiskSpace;
use gs2e_store::{FORMAT, Store, StoreAccess, StoreOptions};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use trial::{TrialPicture, TrialScene};

/// Arguments of `doctor`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Add its output to a report of an error. The trial renders the embedded scene for about a second on the CPU and \
    on each GPU. gs2e writes nothing; the driver of a GPU may keep compiled shaders in its own cache, as Mesa does in ~/.cache."
)]
pub(super) struct DoctorArgs {
    /// Leave out the trial
    #[arg(long)]
    no_trial: bool,
}

/// Prints the versions of Python and of the packages that the loader needs.
const PYTHON: &str = "import sys, h5py, numpy; print('Python', sys.version.split()[0], 'h5py', h5py.__version__, 'numpy', numpy.__version__)";

/// Other programs, their arguments for a version, and their purpose.
const PROGRAMS: [(&str, &[&str], &str); 6] = [
    ("colmap", &["help"], "poses of photos and videos"),
    ("ffmpeg", &["-version"], "frames of videos"),
    ("python3", &["-c", PYTHON], "the loader of a release"),
    ("sbatch", &["--version"], "gs2e submit"),
    ("apptainer", &["--version"], "gs2e submit --container"),
    ("minisign", &["-v"], "keys of signatures"),
];

/// The lines for people, and the values for programs.
#[derive(Default)]
struct DoctorPage {
    rows: Vec<(String, String)>,
    value: serde_json::Map<String, Value>,
}

impl DoctorPage {
    fn row(&mut self, label: &str, text: impl Into<String>) {
        self.rows.push((label.to_owned(), text.into()));
    }

    fn set(&mut self, values: Value) {
        let Value::Object(values) = values else { return };
        self.value.extend(values);
    }
}

impl DoctorArgs {
    pub(super) fn run(self, common: &CommonArgs, console: &Console) -> Result<ExitKind, VerbError> {
        let mut page = DoctorPage::default();
        this_program(&mut page);
        processor(common, &mut page);
        store(&common.store, &mut page);
        self.renderers(common, &mut page)?;
        other_programs(&common.programs(), &mut page);
        if console.json {
            console.result(&Value::Object(page.value));
        } else {
            let width = page.rows.iter().map(|(label, _)| label.chars().count()).max().unwrap_or(0);
            page.rows.iter().for_each(|(label, text)| console.print(&format!("{label:width$}  {text}")));
        }
        Ok(ExitKind::Done)
    }

    fn renderers(&self, common: &CommonArgs, page: &mut DoctorPage) -> Result<(), VerbError> {
        let scene = (!self.no_trial).then(TrialScene::new);
        let on_cpu = scene.as_ref().map(|scene| scene.render(&Backend::Cpu));
        let rate = on_cpu.as_ref().map(|done| done.as_ref().map_or_else(Clone::clone, TrialPicture::rate));
        page.row("CPU renderer", rate.clone().unwrap_or_else(|| "not tried".to_owned()));
        let listed = gpu::list_gpus(common.features_left_out());
        let mut values = Vec::new();
        match &listed {
            Err(because) => page.row("GPU", because.to_string()),
            Ok(listed) => {
                for (index, gpu) in listed.iter().enumerate() {
                    let trial = scene.as_ref().zip(on_cpu.as_ref());
                    let tried = trial.map(|(scene, on_cpu)| try_gpu(scene, on_cpu, gpu));
                    let label = format!("GPU {index}");
                    let ListedGpu { name, kind, driver, binding, buffer, opened, .. } = gpu;
                    let used = opened.as_ref().map(gpu::GpuDevice::features).unwrap_or_default();
                    let sizes = [binding, buffer].map(|bytes| format_amount(*bytes, "B"));
                    page.row(&label, format!("{name}, {kind}, driver {driver}"));
                    page.row("", format!("bindings to {}, buffers to {}", sizes[0], sizes[1]));
                    page.row("", gpu_features(gpu, used));
                    let because = opened.as_ref().err().map(ToString::to_string);
                    page.row("", because.clone().or(tried.clone()).unwrap_or_else(|| "not tried".to_owned()));
                    values.push(json!({
                        "index": index, "name": name, "kind": kind, "driver": driver, "binding": binding,
                        "buffer": buffer, "features": feature_names(gpu.features), "used": feature_names(used),
                        "subgroups": gpu.subgroups, "because": because, "trial": tried,
                    }));
                }
            }
        }
        let used = used_renderer(common)?;
        page.row("used by default", used.clone());
        let error = listed.err().map(|because| because.to_string());
        page.set(json!({ "cpu_trial": rate, "gpus": values, "gpu_error": error, "used": used }));
        Ok(())
    }
}

/// The features of a GPU, and whether they are used.
fn gpu_features(gpu: &ListedGpu, used: FeatureSet) -> String {
    let [least, most] = gpu.subgroups;
    let text = |feature: GpuFeature| {
        let name = match feature {
            GpuFeature::Subgroups => format!("subgroups of {least} to {most}"),
            GpuFeature::Timestamps => feature.name().to_owned(),
        };
        match (gpu.features.has(feature), used.has(feature)) {
            (false, _) => format!("no {}", feature.name()),
            (true, false) => format!("{name} left out"),
            (true, true) => name,
        }
    };
    GpuFeature::ALL.map(text).join(", ")
}

fn feature_names(features: FeatureSet) -> Vec<&'static str> {
    GpuFeature::ALL.into_iter().filter(|feature| features.has(*feature)).map(GpuFeature::name).collect()
}

fn this_program(page: &mut DoctorPage) {
    let system = format!("{} {}", std::env::consts::OS, std::env::consts::ARCH);
    let s3 = cfg!(feature = "s3");
    let buckets = if s3 { "with S3" } else { "without S3" };
    let version = env!("CARGO_PKG_VERSION");
    page.row("gs2e", format!("{version}, {system}, {buckets}"));
    page.set(json!({ "version": version, "system": system, "s3": s3 }));
}

fn processor(common: &CommonArgs, page: &mut DoctorPage) {
    let name = machine::processor_name();
    let cores = machine::available_cores();
    // The variant without the value that proves it.
    let level = format!("{:?}", Level::new());
    let level = level.split('(').next().unwrap_or_default().to_owned();
    let memory = machine::free_memory();
    let named = name.as_deref().unwrap_or("unknown processor");
    page.row("processor", format!("{named}, {cores} cores, vectors {level}"));
    let free = if memory == u64::MAX { "unknown".to_owned() } else { format_amount(memory, "B") };
    page.row("memory", format!("{free} for steps (80 % of what is free)"));
    page.row("cores in use", common.cores().to_string());
    let memory = (memory != u64::MAX).then_some(memory);
    page.set(json!({ "processor": name, "cores": cores, "vectors": level, "memory": memory }));
}

/// The store, and the file system on which it is or would be.
fn store(path: &Path, page: &mut DoctorPage) {
    // For reading: it creates no store, and does not wait for the lock of a build that is running.
    let opened = Store::open(path, StoreOptions::from(StoreAccess::Read), &mut |_| {});
    let text = match &opened {
        Err(because) => because.to_string(),
        Ok(_) if !is_there(path) => format!("{}, not there yet", path.display()),
        Ok(_) => format!("{}, format {FORMAT}", path.display()),
    };
    page.row("store", text.clone());
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    // A folder that does not exist has no file system. Its nearest existing parent is where it would be
    // created.
    let there = absolute.ancestors().find(|folder| is_there(folder)).unwrap_or(Path::new("/"));
    let disk = DiskSpace::holding_path(there);
    let words = match &disk {
        Err(because) => because.to_string(),
        Ok(disk) => {
            let remote = if disk.is_remote() { "; it is remote: use --shared-store for it" } else { "" };
            let (free, mount) = (format_amount(disk.free, "B"), disk.mount.display());
            format!("{free} free, {} on {mount}{remote}", disk.kind)
        }
    };
    page.row("disk", words);
    let (free, kind) = disk.map(|disk| (disk.free, disk.kind)).ok().unzip();
    page.set(json!({ "store": text, "disk_free": free, "file_system": kind }));
}

/// The trial of a GPU, compared with the picture of the CPU.
fn try_gpu(scene: &TrialScene, on_cpu: &Result<TrialPicture, String>, gpu: &ListedGpu) -> String {
    let Ok(device) = &gpu.opened else { return "not tried".to_owned() };
    match (scene.render(&Backend::from(device.clone())), on_cpu) {
        (Err(because), _) => because,
        (Ok(picture), Ok(on_cpu)) => format!("{}, {}", picture.rate(), picture.likeness(on_cpu)),
        (Ok(picture), Err(_)) => picture.rate(),
    }
}

/// The renderer that `--backend auto` takes, and why.
fn used_renderer(common: &CommonArgs) -> Result<String, VerbError> {
    if common.backend != BackendArg::Auto {
        return Ok(common.backend()?.class());
    }
    let choice = common.gpu.clone().unwrap_or(gpu::DeviceChoice::Hardware);
    Ok(match gpu::GpuPool::open(&choice, common.features_left_out()) {
        Ok(pool) => pool.name(),
        Err(because) => format!("the CPU, because {because}"),
    })
}

fn other_programs(programs: &ProgramFinder, page: &mut DoctorPage) {
    let mut values = BTreeMap::new();
    for (name, arguments, purpose) in PROGRAMS {
        let said = programs.ask(name, arguments).unwrap_or_default();
        let mut lines = said.lines().map(str::trim);
        // Without its packages, Python says so in the last line.
        let version = if name == "python3" { lines.next_back() } else { lines.find(|line| !line.is_empty()) };
        page.row(name, version.map_or_else(|| format!("not found; it is for {purpose}"), str::to_owned));
        values.insert(name, version.map(str::to_owned));
    }
    page.set(json!({ "programs": values }));
}

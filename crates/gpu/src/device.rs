//! Enumeration of the machine's GPUs, and opening one of them.

use super::features::{FeatureSet, GpuFeature};
use super::pool::PoolPlace;
use super::shader::{GROUP, LEAST_SUBGROUP};
use gs2e_render::{GpuError, RenderStyle};
use std::pin::pin;
use std::str::FromStr;
use std::sync::{Arc, Mutex, PoisonError};
use std::task::{Context, Poll, Waker};
use wgpu::{Adapter, AdapterInfo, Backends, DeviceType, ErrorFilter, Limits};

/// The choice of a GPU.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub enum DeviceChoice {
    /// The most capable one. A software implementation only if there is no other.
    #[default]
    Any,
    /// The most capable hardware GPU. Software implementations are slower than the CPU renderer.
    Hardware,
    /// Like [`Self::Any`], and all others of the same kind with the same driver, for many scenes at once. A
    /// single scene is rendered by one.
    All,
    /// The GPU at this index in the list of all, from 0.
    Index(usize),
    /// The GPU with this text in its name, ignoring case.
    Name(String),
}

impl FromStr for DeviceChoice {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        if text == "all" {
            return Ok(Self::All);
        }
        Ok(text.parse().map_or_else(|_| Self::Name(text.to_owned()), Self::Index))
    }
}

/// An open GPU.
#[derive(Debug, Clone)]
pub struct GpuDevice {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    name: String,
    fingerprint: String,
    /// Largest binding of a shader, bytes.
    pub(super) limit: u64,
    /// Largest allocation, bytes, if it is limited here and not by the driver.
    room: Option<u64>,
    features: FeatureSet,
    /// The pictures are spoilt, as by a faulty driver.
    is_spoilt: bool,
    trouble: Arc<Mutex<Option<String>>>,
    /// Held, and given back when the last clone is dropped.
    place: Option<Arc<PoolPlace>>,
}

/// The part of the numerical class that does not depend on the GPU and its driver. Raise it with
/// every change of a pixel's bits.
const CLASS: &str = "gpu/1";

impl GpuDevice {
    /// Opens one of the machine's GPUs.
    ///
    /// # Errors
    /// There is no GPU, none matches, or it lacks what WebGPU guarantees.
    pub fn open(choice: &DeviceChoice) -> Result<Self, GpuError> {
        Self::open_without(choice, FeatureSet::NONE)
    }

    /// Opens one of the machine's GPUs without some of its features.
    ///
    /// # Errors
    /// There is no GPU, none matches, or it lacks what WebGPU guarantees.
    pub fn open_without(choice: &DeviceChoice, without: FeatureSet) -> Result<Self, GpuError> {
        if *choice == DeviceChoice::Hardware && !may_have_hardware() {
            return Err(GpuError::None("this system has no device node of a GPU".to_owned()));
        }
        let mut adapters = list_adapters()?;
        let infos: Vec<AdapterInfo> = adapters.iter().map(Adapter::get_info).collect();
        let at = choose_adapter(&infos, choice)?;
        Self::from_adapter(&adapters.swap_remove(at), without)
    }

    /// Opens all GPUs that a choice means, the most capable one first: several for [`DeviceChoice::All`]
    /// only.
    pub(super) fn open_all(choice: &DeviceChoice, without: FeatureSet) -> Result<Vec<Self>, GpuError> {
        if *choice != DeviceChoice::All {
            return Self::open_without(choice, without).map(|device| vec![device]);
        }
        let adapters = list_adapters()?;
        let infos: Vec<AdapterInfo> = adapters.iter().map(Adapter::get_info).collect();
        let first = choose_adapter(&infos, choice)?;
        let mut devices = vec![Self::from_adapter(&adapters[first], without)?];
        // A GPU that cannot be opened is no reason to leave the others idle.
        let others = like(&infos, first).filter_map(|at| Self::from_adapter(&adapters[at], without).ok());
        devices.extend(others);
        Ok(devices)
    }

    pub(super) fn at_place(mut self, place: PoolPlace) -> Self {
        self.place = Some(Arc::new(place));
        self
    }

    fn from_adapter(adapter: &Adapter, without: FeatureSet) -> Result<Self, GpuError> {
        let info = adapter.get_info();
        let name = adapter_name(&info);
        let theirs = adapter.limits();
        refuse_small(&name, &theirs)?;
        // Only the sizes are raised; all else is the default that WebGPU guarantees.
        let required_limits = Limits {
            max_storage_buffer_binding_size: theirs.max_storage_buffer_binding_size,
            max_buffer_size: theirs.max_buffer_size,
            ..Limits::default()
        };
        let limit = theirs.max_storage_buffer_binding_size.min(theirs.max_buffer_size);
        let features = features_of(adapter).without(without);
        let required_features = wgpu_features(features);
        let wanted = wgpu::DeviceDescriptor { required_features, required_limits, ..Default::default() };
        let (device, queue) = wait_for(adapter.request_device(&wanted))
            .map_err(|e| GpuError::Refused { adapter: name.clone(), because: e.to_string() })?;
        let trouble = Arc::new(Mutex::new(None));
        let note = |trouble: &Arc<Mutex<Option<String>>>, because: String| {
            // The first failure is kept. Later ones are often its consequences.
            trouble.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(because);
        };
        let noted = trouble.clone();
        device
            .set_device_lost_callback(move |reason, because| note(&noted, format!("{reason:?}: {because}")));
        let noted = trouble.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| note(&noted, error.to_string())));
        let driver = [info.driver.as_str(), info.driver_info.as_str()].join(" ");
        let fingerprint = format!("{CLASS} {} {} {driver}", info.backend, info.name).trim().to_owned();
        Ok(Self {
            device,
            queue,
            name,
            fingerprint,
            limit,
            room: None,
            features,
            is_spoilt: false,
            trouble,
            place: None,
        })
    }

    /// Name and interface of the GPU.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The numerical class of its images: this program's version, the GPU and its driver.
    #[must_use]
    pub fn fingerprint(&self) -> &str {
        &self.fingerprint
    }

    /// Limits each binding to at most this many bytes.
    #[must_use]
    pub fn with_limit(mut self, bytes: u64) -> Self {
        self.limit = self.limit.min(bytes);
        self
    }

    /// Limits each allocation, for the scene and for a view's lists and images, to at most this
    /// many bytes.
    #[must_use]
    pub fn with_room(mut self, bytes: u64) -> Self {
        self.room = Some(bytes);
        self
    }

    /// The limit of [`Self::with_room`].
    #[must_use]
    pub fn room(&self) -> Option<u64> {
        self.room
    }

    /// Spoils the pictures, as a faulty driver does.
    #[must_use]
    pub fn with_spoilt_pictures(mut self) -> Self {
        self.is_spoilt = true;
        self
    }

    /// The style that is rendered.
    pub(super) fn spoilt_style(&self, style: RenderStyle) -> RenderStyle {
        if self.is_spoilt { RenderStyle { background: [f32::NAN; 3], ..style } } else { style }
    }

    /// The features of the GPU that are used.
    #[must_use]
    pub fn features(&self) -> FeatureSet {
        self.features
    }

    /// Memory of the device that this process holds, in use and reserved, in bytes, as far as it is known.
    #[must_use]
    pub fn memory_held(&self) -> Option<[u64; 2]> {
        let report = self.device.generate_allocator_report()?;
        Some([report.total_allocated_bytes, report.total_reserved_bytes])
    }

    /// Destroys the device. Later operations fail.
    pub fn destroy(&self) {
        self.device.destroy();
    }

    /// Returns an error if the device has failed.
    pub(super) fn check(&self) -> Result<(), GpuError> {
        let trouble = self.trouble.lock().unwrap_or_else(PoisonError::into_inner).clone();
        trouble.map_or(Ok(()), |because| Err(self.lost(&because)))
    }

    /// The error of a lost device, which no renderer gets from now on.
    pub(super) fn lost(&self, because: &str) -> GpuError {
        // Drivers may give reasons of several lines; a message has one line.
        let because = because.split_whitespace().collect::<Vec<_>>().join(" ");
        self.trouble.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert_with(|| because.clone());
        GpuError::Lost { adapter: self.name.clone(), because }
    }

    /// Runs `make`, which allocates this many bytes of device memory, and reports an allocation
    /// failure.
    pub(super) fn allocate<T>(
        &self,
        what: &'static str,
        wanted: u64,
        make: impl FnOnce(&wgpu::Device) -> T,
    ) -> Result<T, GpuError> {
        self.check()?;
        let full = |because| GpuError::Memory { adapter: self.name.clone(), what, wanted, because };
        if let Some(room) = self.room.filter(|room| wanted > *room) {
            return Err(full(format!("{room} bytes are free")));
        }
        // Only a lack of memory is caught here. Other errors arrive through the device's callback.
        let scope = self.device.push_error_scope(ErrorFilter::OutOfMemory);
        let made = make(&self.device);
        match wait_for(scope.pop()) {
            None => self.check().map(|()| made),
            Some(error) => Err(full(error.to_string())),
        }
    }

    pub(super) fn not_finite(&self) -> GpuError {
        GpuError::NotFinite { adapter: self.name.clone() }
    }

    pub(super) fn too_small(&self, what: &'static str) -> GpuError {
        GpuError::Tile { adapter: self.name.clone(), what, limit: self.limit }
    }
}

/// The features of an adapter.
fn features_of(adapter: &Adapter) -> FeatureSet {
    let (has, info) = (|feature| adapter.features().contains(feature), adapter.get_info());
    let subgroups = has(wgpu::Features::SUBGROUP) && info.subgroup_min_size >= LEAST_SUBGROUP;
    FeatureSet::NONE
        .with(GpuFeature::Subgroups, subgroups)
        .with(GpuFeature::Timestamps, has(wgpu::Features::TIMESTAMP_QUERY))
}

fn wgpu_features(features: FeatureSet) -> wgpu::Features {
    let names = [
        (GpuFeature::Subgroups, wgpu::Features::SUBGROUP),
        (GpuFeature::Timestamps, wgpu::Features::TIMESTAMP_QUERY),
    ];
    let used = names.into_iter().filter(|(feature, _)| features.has(*feature));
    used.fold(wgpu::Features::empty(), |all, (_, feature)| all | feature)
}

/// Refuses a GPU that cannot render any frame. A driver would refuse it too, without a size.
fn refuse_small(name: &str, limits: &Limits) -> Result<(), GpuError> {
    /// Images of one tile in all channels, its list, and some hundred splats, in bytes.
    const LEAST_BINDING: u64 = 1 << 16;
    let defaults = Limits::default();
    let binding = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    let [buffers, least_buffers] =
        [limits, &defaults].map(|limits| u64::from(limits.max_storage_buffers_per_shader_stage));
    let [memory, least_memory] =
        [limits, &defaults].map(|limits| u64::from(limits.max_compute_workgroup_storage_size));
    let threads = limits.max_compute_invocations_per_workgroup.min(limits.max_compute_workgroup_size_x);
    let wanted = [
        ("bytes in a storage buffer", binding, LEAST_BINDING),
        ("storage buffers in a shader", buffers, least_buffers),
        ("bytes of workgroup memory", memory, least_memory),
        ("threads in a workgroup", threads.into(), GROUP.into()),
    ];
    match wanted.into_iter().find(|(_, found, least)| found < least) {
        None => Ok(()),
        Some((what, found, wanted)) => {
            Err(GpuError::Limits { adapter: name.to_owned(), what, found, wanted })
        }
    }
}

/// The index of the adapter that the choice means.
fn choose_adapter(infos: &[AdapterInfo], choice: &DeviceChoice) -> Result<usize, GpuError> {
    let fits = |info: &AdapterInfo, i: usize| match choice {
        DeviceChoice::Any | DeviceChoice::All => true,
        DeviceChoice::Hardware => info.device_type != DeviceType::Cpu,
        DeviceChoice::Index(wanted) => i == *wanted,
        DeviceChoice::Name(part) => info.name.to_lowercase().contains(&part.to_lowercase()),
    };
    let mut matching = infos.iter().enumerate().filter(|(i, info)| fits(info, *i));
    let Some((at, chosen)) = matching.next() else {
        let found = infos.iter().map(adapter_name).collect::<Vec<_>>().join(", ");
        let wanted = match choice {
            DeviceChoice::Any | DeviceChoice::All | DeviceChoice::Hardware => "a hardware device".to_owned(),
            DeviceChoice::Index(i) => format!("number {i}"),
            DeviceChoice::Name(part) => format!("called `{part}`"),
        };
        return Err(GpuError::Other { wanted, found });
    };
    // One GPU that two interfaces offer is no second one.
    let others = matching.filter(|(_, info)| info.backend == chosen.backend).count();
    match choice {
        DeviceChoice::Name(wanted) if others > 0 => {
            let numbered = infos.iter().enumerate().map(|(i, info)| format!("{i}: {}", adapter_name(info)));
            let found = numbered.collect::<Vec<_>>().join(", ");
            Err(GpuError::Several { count: others + 1, wanted: wanted.clone(), found })
        }
        _ => Ok(at),
    }
}

/// The other adapters of the same kind: name, interface and driver are the same.
fn like(infos: &[AdapterInfo], chosen: usize) -> impl Iterator<Item = usize> {
    let kind = |info: &AdapterInfo| {
        (info.name.clone(), info.backend, info.driver.clone(), info.driver_info.clone(), info.device_type)
    };
    let wanted = kind(&infos[chosen]);
    (0..infos.len()).filter(move |at| *at != chosen && kind(&infos[*at]) == wanted)
}

/// A GPU of this machine.
#[derive(Debug)]
pub struct ListedGpu {
    /// Name and interface.
    pub name: String,
    /// The kind: `discrete`, `integrated`, `virtual`, `software` or `other`.
    pub kind: &'static str,
    /// Name and version of the driver.
    pub driver: String,
    /// Largest binding of a shader, bytes.
    pub binding: u64,
    /// Largest buffer, bytes.
    pub buffer: u64,
    /// The features that the renderer can use.
    pub features: FeatureSet,
    /// Threads of the smallest and of the largest subgroup.
    pub subgroups: [u32; 2],
    /// The open device, or the reason why it cannot be used.
    pub opened: Result<GpuDevice, GpuError>,
}

/// All GPUs of this machine, in the order of [`DeviceChoice::Index`], opened without some features.
///
/// # Errors
/// The machine has no GPU.
pub fn list_gpus(without: FeatureSet) -> Result<Vec<ListedGpu>, GpuError> {
    let listed = |adapter: Adapter| {
        let (info, limits) = (adapter.get_info(), adapter.limits());
        let driver = [info.driver.as_str(), info.driver_info.as_str()].join(" ").trim().to_owned();
        ListedGpu {
            name: adapter_name(&info),
            kind: match info.device_type {
                DeviceType::DiscreteGpu => "discrete",
                DeviceType::IntegratedGpu => "integrated",
                DeviceType::VirtualGpu => "virtual",
                DeviceType::Cpu => "software",
                DeviceType::Other => "other",
            },
            driver,
            binding: limits.max_storage_buffer_binding_size,
            buffer: limits.max_buffer_size,
            features: features_of(&adapter),
            subgroups: [info.subgroup_min_size, info.subgroup_max_size],
            opened: GpuDevice::from_adapter(&adapter, without),
        }
    };
    Ok(list_adapters()?.into_iter().map(listed).collect())
}

/// Returns true if a hardware GPU may be present. No driver is loaded for the answer: a software
/// implementation alone is a library of 60 MB.
fn may_have_hardware() -> bool {
    if !cfg!(target_os = "linux") {
        return true;
    }
    // Render nodes of kernel drivers, the device nodes of NVIDIA, and the node of Linux under
    // Windows.
    let nodes = ["/dev/dri", "/dev/nvidiactl", "/dev/dxg"];
    nodes.iter().any(|node| gs2e_files::is_there(std::path::Path::new(node)))
}

/// All GPUs, the most capable kind first. A GPU that several interfaces offer comes first with the
/// fastest of them.
fn list_adapters() -> Result<Vec<Adapter>, GpuError> {
    let mut wanted = wgpu::InstanceDescriptor::new_without_display_handle();
    wanted.backends = Backends::VULKAN | Backends::METAL | Backends::DX12;
    wanted.flags = wgpu::InstanceFlags::empty();
    let instance = wgpu::Instance::new(wanted);
    let mut all = wait_for(instance.enumerate_adapters(Backends::all()));
    // The sort is stable, so adapters of one kind stay in the order of their interfaces.
    all.sort_by_key(|a| match a.get_info().device_type {
        DeviceType::DiscreteGpu => 0,
        DeviceType::IntegratedGpu => 1,
        DeviceType::VirtualGpu => 2,
        DeviceType::Other => 3,
        DeviceType::Cpu => 4,
    });
    if all.is_empty() {
        let asked = instance.request_adapter(&wgpu::RequestAdapterOptions::default());
        return Err(GpuError::None(
            wait_for(asked).err().map_or_else(String::new, |e| missing_reasons(&e.to_string())),
        ));
    }
    Ok(all)
}

/// The reasons for missing GPUs, without interfaces that this system does not have.
fn missing_reasons(text: &str) -> String {
    let parts = text.split([';', ',']).map(str::trim).skip(1);
    let ours: Vec<&str> =
        parts.filter(|part| !part.ends_with("not requested") && !part.ends_with("not compiled in")).collect();
    if ours.is_empty() { text.to_owned() } else { ours.join(", ") }
}

fn adapter_name(info: &AdapterInfo) -> String {
    format!("{} ({})", info.name, info.backend)
}

/// The value of a future. Futures of native devices are ready at once, or after a poll.
pub(super) fn wait_for<F: Future>(future: F) -> F::Output {
    let mut future = pin!(future);
    loop {
        if let Poll::Ready(value) = future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            return value;
        }
        std::thread::yield_now();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gpu_is_chosen_by_place_or_by_name() {
        assert_eq!("1".parse(), Ok(DeviceChoice::Index(1)));
        assert_eq!("all".parse(), Ok(DeviceChoice::All));
        assert_eq!("RTX 4090".parse(), Ok(DeviceChoice::Name("RTX 4090".to_owned())));
    }

    #[test]
    fn a_name_of_two_gpus_is_refused_and_that_of_two_interfaces_is_not() {
        let info = |name: &str, device_type, backend| AdapterInfo {
            name: name.to_owned(),
            ..AdapterInfo::new(device_type, backend)
        };
        let (gpu, vulkan, metal) = (DeviceType::DiscreteGpu, wgpu::Backend::Vulkan, wgpu::Backend::Metal);
        let infos = [
            info("RTX A", gpu, vulkan),
            info("RTX B", gpu, vulkan),
            info("llvmpipe", DeviceType::Cpu, vulkan),
        ];
        let choose = |text: &str| choose_adapter(&infos, &text.parse().unwrap());
        assert_eq!((choose("1"), choose("rtx b"), choose("pipe")), (Ok(1), Ok(1), Ok(2)));
        let error = choose("rtx").unwrap_err().to_string();
        let wanted =
            "2 GPUs are called `rtx`; there is 0: RTX A (vulkan), 1: RTX B (vulkan), 2: llvmpipe (vulkan)";
        assert_eq!(error, wanted);
        assert!(choose("3").is_err() && choose("radeon").is_err());
        let twice =
            [info("M1", DeviceType::IntegratedGpu, metal), info("M1", DeviceType::IntegratedGpu, vulkan)];
        assert_eq!(choose_adapter(&twice, &"m1".parse().unwrap()), Ok(0));
    }

    #[test]
    fn all_gpus_are_those_of_the_first_kind() {
        let info = |name: &str, device_type, backend, driver: &str| AdapterInfo {
            name: name.to_owned(),
            driver: driver.to_owned(),
            ..AdapterInfo::new(device_type, backend)
        };
        let (gpu, vulkan, dx12) = (DeviceType::DiscreteGpu, wgpu::Backend::Vulkan, wgpu::Backend::Dx12);
        let infos = [
            info("RTX A", gpu, vulkan, "1"),
            info("RTX B", gpu, vulkan, "1"),
            info("RTX A", gpu, vulkan, "1"),
            info("RTX A", gpu, dx12, "1"),
            info("RTX A", gpu, vulkan, "2"),
            info("RTX A", gpu, vulkan, "1"),
        ];
        let first = choose_adapter(&infos, &DeviceChoice::All).unwrap();
        assert_eq!((first, like(&infos, first).collect()), (0, vec![2, 5]));
    }

    #[test]
    fn a_gpu_without_the_needed_sizes_is_refused_by_name() {
        let refused = |change: &dyn Fn(&mut Limits)| {
            let mut limits = Limits::default();
            change(&mut limits);
            refuse_small("Voodoo 2", &limits).map_err(|error| error.to_string())
        };
        assert_eq!(refused(&|_| ()), Ok(()));
        let small = refused(&|limits| limits.max_storage_buffer_binding_size = 4096);
        let wanted =
            "Voodoo 2 cannot be used: it has at most 4096 bytes in a storage buffer, wanted at least 65536";
        assert_eq!(small.unwrap_err(), wanted);
        assert!(refused(&|limits| limits.max_buffer_size = 0).is_err());
        assert!(refused(&|limits| limits.max_storage_buffers_per_shader_stage = 4).is_err());
        assert!(refused(&|limits| limits.max_compute_workgroup_storage_size = 8192).is_err());
        assert!(refused(&|limits| limits.max_compute_workgroup_size_x = 128).is_err());
        // What WebGL2 guarantees has no compute shaders.
        assert!(refused(&|limits| *limits = Limits::downlevel_webgl2_defaults()).is_err());
    }

    #[test]
    fn what_is_missing_is_told_of_this_system_alone() {
        let message = "No suitable graphics adapter found; noop not requested, vulkan drivers/libraries could not be \
                    loaded, metal support not compiled in, dx12 support not compiled in, gl not requested";
        assert_eq!(missing_reasons(message), "vulkan drivers/libraries could not be loaded");
        assert_eq!(missing_reasons("anything else"), "anything else");
    }
}

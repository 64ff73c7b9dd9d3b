//! The text of the shaders, with constants generated from their Rust definitions.

use gs2e_image::LUMINANCE_WEIGHTS;
use gs2e_render::cpu::activate::MIN_NORM;
use gs2e_render::shared::{
    AFFINE_DOUBTFUL, AFFINE_INVALID, COMPENSATION_FLOOR, DEPTH_MIN_ALPHA, DILATION, EXTENT_ROOT_FLOOR,
    EXTENT_SIGMAS, GSPLAT_FAR, GSPLAT_NEAR, GSPLAT_SIGMAS, MAX_ALPHA, NEAR, STOP, TILE, least_alpha,
};
use gs2e_render::{ChannelSet, RenderRules, RenderStyle};
use gs2e_scene::sh;
use std::f64::consts::LOG2_E;
use std::fmt::{Display, Write as _};

/// Threads of a workgroup, except in the raster pass.
pub(super) const GROUP: u32 = 256;
/// Entries that a workgroup sorts. Must stay below 65,536, because the sort's counters have 16
/// bits.
pub(super) const BLOCK: u32 = 4096;
/// Threads of the smallest subgroup with which sums are made by subgroups.
pub(super) const LEAST_SUBGROUP: u32 = 4;
/// Bits of a digit of the sort.
pub(super) const DIGIT_BITS: u32 = 4;
/// Splats in the workgroup memory of a tile: with rates 12 KiB of the 16 KiB that every device has.
const BATCH: u32 = 128;

/// Threads of a workgroup that takes the layers of a tile away. At the begin and the end of a batch of
/// layers, threads wait for each other's pixels: few do if the width is far below a tile's 256 pixels.
pub(super) const WAVE: u32 = 64;
/// Floats per pixel of the trace.
const TRACE: u32 = 2;
/// Sums per pair of tile and splat.
pub(super) const SUMS: u32 = 10;
/// Rows of four words per splat of the gradients.
pub(super) const GRADIENT_ROWS: u32 = 5;

/// Opacity that marks a Gaussian with a field that is not finite.
pub(super) const SPOILT: f32 = -1.0;
/// Opacity that marks a Gaussian with a position that is not finite.
pub(super) const LOST: f32 = -2.0;
/// Depth that marks undefined depth, because NaN is not portable.
pub(super) const UNDEFINED: f32 = -1.0;

/// A counter in `totals`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Total {
    Splats,
    Pairs,
    Behind,
    Degenerate,
    Outside,
    Doubtful,
    Invalid,
    Stopped,
    Blended,
    BlendedCarry,
    /// Entries of lists that tiles have loaded.
    Loaded,
}

/// Number of counters in `totals`.
pub(super) const TOTALS: usize = Total::Loaded as usize + 1;

/// A dispatch with a size that the device computes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Dispatch {
    /// One thread per splat.
    Splats,
    /// One workgroup per block of splats in a sort.
    SplatBlocks,
    /// One thread per splat; none if the pairs exceed their capacity.
    ListedSplats,
    /// One workgroup per block of pairs in a sort.
    PairBlocks,
}

/// Number of these dispatches.
pub(super) const DISPATCHES: u64 = Dispatch::PairBlocks as u64 + 1;

impl Dispatch {
    /// Offset of its size in the buffer, bytes.
    pub(super) fn offset(self) -> u64 {
        self as u64 * 12
    }
}

/// Place of each image, in floats per pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ImageLayout {
    pub(super) rgb: Option<u32>,
    pub(super) grey: Option<u32>,
    pub(super) alpha: Option<u32>,
    pub(super) depth: Option<u32>,
    pub(super) doubtful: Option<u32>,
    pub(super) rate: Option<u32>,
    /// The trace that the gradients need stays on the device, after all images.
    pub(super) trace: Option<u32>,
    /// Total of the images, in floats per pixel.
    pub(super) floats: u32,
}

impl ImageLayout {
    /// The layout for these channels. Flow is computed from depth.
    pub(super) fn new(want: ChannelSet) -> Self {
        // The shaders and the host both take the places from here.
        let mut floats = 0;
        let mut next = |wanted: bool, n: u32| {
            let at = floats;
            floats += if wanted { n } else { 0 };
            wanted.then_some(at)
        };
        let rgb = next(want.rgb, 3);
        let grey = next(want.luminance, 1);
        let alpha = next(want.alpha, 1);
        let depth = next(want.depth || want.flow, 1);
        let doubtful = next(want.doubtful, 1);
        let rate = next(want.luminance_rate, 1);
        Self { rgb, grey, alpha, depth, doubtful, rate, trace: None, floats }
    }

    /// The layout with a trace: the light that is left, and the place of the last blended layer.
    pub(super) fn with_trace(self) -> Self {
        Self { trace: Some(self.floats), ..self }
    }

    /// Total of the images and the trace, in floats per pixel.
    pub(super) fn floats_on_device(self) -> u32 {
        self.floats + if self.trace.is_some() { TRACE } else { 0 }
    }
}

/// Rows of four words per splat.
pub(super) fn splat_rows(rate: bool) -> u32 {
    if rate { 6 } else { 4 }
}

/// One of the shaders.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ShaderKind {
    Project,
    Scan,
    Bin,
    Sort,
    Raster,
    Slots,
    Backward,
    Gather,
    Chain,
}

/// Properties of the shaders that depend on scene and frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ShaderVariant {
    pub(super) style: RenderStyle,
    pub(super) sh_degree: u8,
    pub(super) layout: ImageLayout,
    /// Sums over threads are those of subgroups.
    pub(super) subgroups: bool,
}

impl ShaderKind {
    /// All shaders.
    #[cfg(test)]
    pub(super) const ALL: [Self; 9] = [
        Self::Project,
        Self::Scan,
        Self::Bin,
        Self::Sort,
        Self::Raster,
        Self::Slots,
        Self::Backward,
        Self::Gather,
        Self::Chain,
    ];

    /// Name of the shader.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Project => "project",
            Self::Scan => "scan",
            Self::Bin => "bin",
            Self::Sort => "sort",
            Self::Raster => "raster",
            Self::Slots => "slots",
            Self::Backward => "backward",
            Self::Gather => "gather",
            Self::Chain => "chain",
        }
    }

    /// Complete text of the shader.
    pub(super) fn text(self, variant: &ShaderVariant) -> String {
        const FRAME: &str = include_str!("frame.wgsl");
        const SPLAT: &str = include_str!("splat.wgsl");
        const DOUBLE: &str = include_str!("double.wgsl");
        const EYE: &str = include_str!("eye.wgsl");
        let (sums, ranks) = if variant.subgroups {
            (include_str!("sums_by_subgroups.wgsl"), include_str!("ranks_by_subgroups.wgsl"))
        } else {
            (include_str!("sums.wgsl"), include_str!("ranks.wgsl"))
        };
        let parts: &[&str] = match self {
            Self::Project => {
                &[FRAME, sums, DOUBLE, EYE, include_str!("dual.wgsl"), SPLAT, include_str!("project.wgsl")]
            }
            Self::Scan => &[FRAME, sums, include_str!("scan.wgsl")],
            Self::Bin => &[FRAME, sums, SPLAT, include_str!("bin.wgsl")],
            Self::Sort => &[FRAME, sums, include_str!("sort.wgsl"), ranks],
            Self::Raster => &[FRAME, include_str!("raster.wgsl")],
            Self::Slots => &[FRAME, sums, include_str!("slots.wgsl")],
            Self::Backward => &[FRAME, include_str!("backward.wgsl")],
            Self::Gather => &[FRAME, include_str!("gather.wgsl")],
            Self::Chain => &[FRAME, DOUBLE, EYE, include_str!("chain.wgsl")],
        };
        shader_prelude(variant) + &parts.join("\n")
    }
}

/// The functions for sums over threads, with what they need.
#[cfg(test)]
pub(super) fn sums_text(variant: &ShaderVariant) -> String {
    let sums =
        if variant.subgroups { include_str!("sums_by_subgroups.wgsl") } else { include_str!("sums.wgsl") };
    shader_prelude(variant) + include_str!("frame.wgsl") + sums
}

/// Constants for all shaders.
fn shader_prelude(variant: &ShaderVariant) -> String {
    let mut text = String::new();
    let rules = variant.style.rules;
    let rate = variant.layout.rate.is_some();
    let mut bools = |name: &str, value: bool| write_constant(&mut text, name, "bool", value);
    bools("ANTIALIASED", variant.style.antialiased);
    bools("RATE", rate);
    for (name, value) in count_words(variant) {
        write_constant(&mut text, name, "u32", format_args!("{value}u"));
    }
    // `T <= STOP`, the stop of `gsplat`, is `T < STOP.next_up()`.
    let stop = if rules == RenderRules::Gsplat { STOP.next_up() } else { STOP };
    for (name, value) in FLOATS.iter().chain(&[("MIN_ALPHA", least_alpha(rules)), ("STOP", stop)]) {
        write_constant(&mut text, name, "f32", float_literal(f64::from(*value)));
    }
    let doubles = [("TO_BINARY", (LOG2_E / 2.0).sqrt()), ("LN_2", std::f64::consts::LN_2)];
    let harmonics = [("SH_0", sh::C0), ("SH_1", sh::C1)];
    for (name, value) in doubles.into_iter().chain(harmonics).chain([("MIN_NORM", MIN_NORM)]) {
        write_constant(&mut text, name, "f32", float_literal(value));
    }
    for (name, values) in [("SH_2", &sh::C2[..]), ("SH_3", &sh::C3[..])] {
        let values: Vec<String> = values.iter().map(|v| float_literal(*v)).collect();
        write_constant(
            &mut text,
            name,
            &format!("array<f32, {}>", values.len()),
            format_args!("array({})", values.join(", ")),
        );
    }
    text
}

const FLOATS: [(&str, f32); 18] = [
    ("NEAR", NEAR),
    ("DILATION", DILATION),
    ("MAX_ALPHA", MAX_ALPHA),
    ("COMPENSATION_FLOOR", COMPENSATION_FLOOR),
    ("EXTENT_SIGMAS", EXTENT_SIGMAS),
    ("EXTENT_ROOT_FLOOR", EXTENT_ROOT_FLOOR),
    ("DEPTH_MIN_ALPHA", DEPTH_MIN_ALPHA),
    ("AFFINE_DOUBTFUL", AFFINE_DOUBTFUL),
    ("AFFINE_INVALID", AFFINE_INVALID),
    ("GSPLAT_NEAR", GSPLAT_NEAR),
    ("GSPLAT_FAR", GSPLAT_FAR),
    ("GSPLAT_SIGMAS", GSPLAT_SIGMAS),
    ("SPOILT", SPOILT),
    ("LOST", LOST),
    ("UNDEFINED", UNDEFINED),
    ("LUMINANCE_R", LUMINANCE_WEIGHTS[0]),
    ("LUMINANCE_G", LUMINANCE_WEIGHTS[1]),
    ("LUMINANCE_B", LUMINANCE_WEIGHTS[2]),
];

#[expect(clippy::cast_possible_truncation, reason = "an edge of a tile is small")]
fn count_words(variant: &ShaderVariant) -> Vec<(&'static str, u32)> {
    let layout = variant.layout;
    let at = |offset: Option<u32>| offset.unwrap_or(u32::MAX);
    vec![
        ("TILE", TILE as u32),
        ("GROUP", GROUP),
        ("BLOCK", BLOCK),
        ("LEAST_SUBGROUP", LEAST_SUBGROUP),
        ("DIGITS", 1 << DIGIT_BITS),
        ("BATCH", BATCH),
        ("SPLAT_ROWS", splat_rows(layout.rate.is_some())),
        ("SH_LEN", (u32::from(variant.sh_degree) + 1).pow(2)),
        // `EXACT` has no constant, because no shader asks for it.
        ("OFFICIAL", RenderRules::Official as u32),
        ("GSPLAT", RenderRules::Gsplat as u32),
        ("SOFT", RenderRules::Soft as u32),
        ("RULES", variant.style.rules as u32),
        ("ABSENT", u32::MAX),
        ("RGB_AT", at(layout.rgb)),
        ("GREY_AT", at(layout.grey)),
        ("ALPHA_AT", at(layout.alpha)),
        ("DEPTH_AT", at(layout.depth)),
        ("DOUBT_AT", at(layout.doubtful)),
        ("RATE_AT", at(layout.rate)),
        ("TRACE_AT", at(layout.trace)),
        ("WAVE", WAVE),
        ("SUMS", SUMS),
        ("GRADIENT_ROWS", GRADIENT_ROWS),
        ("SPLATS", Total::Splats as u32),
        ("PAIRS", Total::Pairs as u32),
        ("BEHIND", Total::Behind as u32),
        ("DEGENERATE", Total::Degenerate as u32),
        ("OUTSIDE", Total::Outside as u32),
        ("DOUBTFUL", Total::Doubtful as u32),
        ("INVALID", Total::Invalid as u32),
        ("FATES", Total::Invalid as u32 - Total::Behind as u32 + 1),
        ("STOPPED", Total::Stopped as u32),
        ("BLENDED", Total::Blended as u32),
        ("BLENDED_CARRY", Total::BlendedCarry as u32),
        ("LOADED", Total::Loaded as u32),
        ("BY_SPLATS", Dispatch::Splats as u32),
        ("BY_SPLAT_BLOCKS", Dispatch::SplatBlocks as u32),
        ("BY_LISTED_SPLATS", Dispatch::ListedSplats as u32),
        ("BY_PAIR_BLOCKS", Dispatch::PairBlocks as u32),
    ]
}

fn write_constant(text: &mut String, name: &str, kind: &str, value: impl Display) {
    let _ = writeln!(text, "const {name}: {kind} = {value};");
}

/// A literal that WGSL parses to the same 32 bits: the shortest decimal does.
#[expect(clippy::cast_possible_truncation, reason = "rounding to 32 bits is what is asked for")]
fn float_literal(value: f64) -> String {
    format!("{:e}f", value as f32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use gs2e_render::LayerOrder;
    use wgpu::naga;

    fn capabilities(variant: &ShaderVariant) -> naga::valid::Capabilities {
        match variant.subgroups {
            true => naga::valid::Capabilities::SUBGROUP,
            false => naga::valid::Capabilities::empty(),
        }
    }

    fn validate(shader: ShaderKind, variant: &ShaderVariant) {
        let text = shader.text(variant);
        let module = naga::front::wgsl::parse_str(&text)
            .unwrap_or_else(|e| panic!("{}: {}", shader.name(), e.emit_to_string(&text)));
        let flags = naga::valid::ValidationFlags::all();
        let mut validator = naga::valid::Validator::new(flags, capabilities(variant));
        validator
            .subgroup_stages(naga::valid::ShaderStages::COMPUTE)
            .subgroup_operations(naga::valid::SubgroupOperationSet::all())
            .validate(&module)
            .unwrap_or_else(|e| panic!("{}: {}", shader.name(), e.emit_to_string(&text)));
        for entry in &module.entry_points {
            let bound = module
                .global_variables
                .iter()
                .filter(|(_, v)| matches!(v.space, naga::AddressSpace::Storage { .. }));
            assert!(bound.count() <= 8, "{}: storage buffers of {}", shader.name(), entry.name);
        }
    }

    #[test]
    fn every_shader_is_valid_within_portable_limits() {
        for rules in [RenderRules::Official, RenderRules::Exact, RenderRules::Gsplat, RenderRules::Soft] {
            for (antialiased, rate) in [(false, false), (true, true)] {
                for sh_degree in 0..=sh::MAX_DEGREE {
                    let want = ChannelSet {
                        rgb: !rate,
                        luminance: rate,
                        luminance_rate: rate,
                        ..ChannelSet::default()
                    };
                    let style =
                        RenderStyle { rules, order: LayerOrder::Depth, antialiased, background: [0.0; 3] };
                    // Only colours are traced. The backward shaders read the trace, so without one
                    // their constants are nonsense, but they are still valid.
                    let layout = ImageLayout::new(want);
                    let layout = if rate { layout } else { layout.with_trace() };
                    for subgroups in [false, true] {
                        let variant = ShaderVariant { style, sh_degree, layout, subgroups };
                        ShaderKind::ALL.iter().for_each(|shader| validate(*shader, &variant));
                    }
                }
            }
        }
    }

    #[test]
    fn images_lie_one_after_another() {
        let all = ChannelSet {
            rgb: true,
            luminance: true,
            flow: true,
            luminance_rate: true,
            ..ChannelSet::default()
        };
        let layout = ImageLayout::new(all);
        assert_eq!([layout.rgb, layout.grey, layout.depth, layout.rate], [0, 3, 4, 5].map(Some));
        assert_eq!((layout.alpha, layout.floats), (None, 6));
        assert_eq!(ImageLayout::new(ChannelSet::default()).floats, 0);
        let traced = layout.with_trace();
        assert_eq!((traced.trace, traced.floats, traced.floats_on_device()), (Some(6), 6, 8));
    }
}

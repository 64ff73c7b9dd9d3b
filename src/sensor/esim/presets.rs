//! The preset of ESIM, which has ranges instead of numbers.

/// Ranges of the preset `randomised`: those of V2V (NeurIPS 2025, arXiv 2505.16797; repository
/// HYLZ-2019/V2V, commit 62ce9c8, `config/train_v2v_e2vid_10k.yaml` and `data/v2v_datasets.py`).
///
/// Thresholds of 0.05 to 2 and a share of hot pixels up to 0.001 are uniform there too. The source
/// draws one threshold, and the other as 1 to 1.5 times as large; here both are drawn by
/// themselves. Its hot pixels have a deviation per voxel bin, which is no rate: the range of the
/// rate has no source.
pub(super) const RANGES: &str = "\
threshold:
  on: { uniform: [0.05, 2] }
  off: { uniform: [0.05, 2] }
hot_pixels:
  share: { uniform: [0, 0.001] }
  rate: { log_uniform: [1, 100] }
";

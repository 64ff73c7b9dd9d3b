//! `gs2e.py`, the loader in every release: one file of plain Python over numpy and h5py.

/// Name of the file.
pub const NAME: &str = "gs2e.py";

/// Content of the file.
pub const TEXT: &str = include_str!("loader/gs2e.py");

/// Holder of the rights in the loader, as stated at its top.
pub(super) const HOLDER: &str = "The gs2e authors";
/// SPDX expression.
pub(super) const LICENCE: &str = "MIT OR Apache-2.0";

/// The ids of its terms. Their texts are shipped with it.
pub fn licence_ids() -> impl Iterator<Item = String> {
    let expression = gs2e_source::licence::LicenceExpression::parse(LICENCE).expect("it is an expression");
    expression.ids().into_iter()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn its_head_says_the_same() {
        let head = format!("# SPDX-FileCopyrightText: {HOLDER}\n# SPDX-License-Identifier: {LICENCE}\n");
        assert!(TEXT.starts_with(&head));
    }
}

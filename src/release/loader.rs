//! `gs2e.py`, the loader in every release: one file of plain Python over numpy and h5py.

/// Name of the file.
pub(super) const NAME: &str = "gs2e.py";

/// What it holds.
pub(super) const TEXT: &str = include_str!("loader/gs2e.py");

/// Who holds the rights in it, and its terms: as its own head says.
pub(super) const HOLDER: &str = "The gs2e authors";
/// SPDX expression.
pub(super) const LICENCE: &str = "MIT OR Apache-2.0";

/// The ids of its terms, whose texts are shipped with it.
pub(super) fn licence_ids() -> impl Iterator<Item = String> {
    let expression = crate::licence::LicenceExpression::parse(LICENCE).expect("it is an expression");
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

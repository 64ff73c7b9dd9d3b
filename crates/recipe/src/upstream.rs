//! The recipe's statements about the dataset that a capture comes from.

use gs2e_source::DiskCapture;

/// Origin of a capture; unknown fields are `None`. It enters no key.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct UpstreamOrigin {
    /// Id of the capture in the dataset.
    pub id: Option<String>,
    /// Address of the dataset.
    pub url: Option<String>,
    /// The date of the download, `YYYY-MM-DD`.
    pub accessed: Option<String>,
    /// True if the terms of the dataset were accepted.
    pub terms_accepted: Option<bool>,
}

impl UpstreamOrigin {
    /// Origin of a capture as far as the layout of its dataset reveals it.
    pub(crate) fn from_capture(captured: &DiskCapture) -> Self {
        let url = captured.kind.dataset().map(|dataset| dataset.url.to_owned());
        Self { id: captured.upstream_id(), url, ..Self::default() }
    }
}

//! Texts of licences: those of the SPDX list, and of terms without an id there.

/// Id of the terms of a scene whose owner states none.
pub(super) const UNSTATED: &str = "LicenseRef-Unstated";

/// Terms without an id in the SPDX list, with the shipped text.
const BUNDLED: [(&str, &str); 4] = [
    (UNSTATED, include_str!("texts/LicenseRef-Unstated.txt")),
    ("LicenseRef-DL3DV-10K-ToU", include_str!("texts/LicenseRef-DL3DV-10K-ToU.txt")),
    ("LicenseRef-TanksAndTemples", include_str!("texts/LicenseRef-TanksAndTemples.txt")),
    ("LicenseRef-MVImgNet-ToU", include_str!("texts/LicenseRef-MVImgNet-ToU.txt")),
];

/// Returns true if this is the id of a licence in the SPDX list.
#[must_use]
pub fn is_listed(id: &str) -> bool {
    spdx::license_id(id).is_some()
}

/// Returns the text of a licence or an exception, with a final newline. For terms known only to
/// their holders, the text says so and names the holders.
#[must_use]
pub fn licence_text(id: &str, holders: &[String]) -> String {
    let own = BUNDLED.iter().find(|(own, _)| *own == id).map(|(_, text)| *text);
    let listed = || spdx::license_id(id).map(spdx::LicenseId::text);
    let exception = || spdx::exception_id(id).map(spdx::ExceptionId::text);
    match own.or_else(listed).or_else(exception) {
        // Texts of the SPDX list end in various ways.
        Some(text) => format!("{}\n", text.trim_end()),
        None => of_holders(id, holders),
    }
}

fn of_holders(id: &str, holders: &[String]) -> String {
    let whom = if holders.is_empty() { "its holder".to_owned() } else { holders.join(", ") };
    format!(
        "{id}\n\nThese terms are not on the SPDX list, and their text is not part of this release. Material under \
         them\nmay be used and redistributed only as its holder allows. Contact: {whom}.\n"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_begin_as_their_licences_do() {
        let t = |id: &str, start: &str| {
            let text = licence_text(id, &[]);
            assert!(text.contains(start), "{id}: {}", &text[..80]);
            assert!(text.ends_with('\n') && !text.ends_with("\n\n"), "{id}");
        };
        t("CC0-1.0", "CC0 1.0 Universal");
        t("CC-BY-4.0", "Attribution 4.0 International");
        t("Classpath-exception-2.0", "special exception");
        t(UNSTATED, "No licence is stated");
        t("LicenseRef-DL3DV-10K-ToU", "DL3DV");
        t("LicenseRef-TanksAndTemples", "Tanks and Temples");
        t("LicenseRef-Ours", "not part of this release");
    }

    #[test]
    fn one_listed_licence_is_told_from_an_expression() {
        for (id, listed) in
            [("CC-BY-4.0", true), ("MIT", true), ("LicenseRef-Ours", false), ("MIT OR CC0-1.0", false)]
        {
            assert_eq!(is_listed(id), listed, "{id}");
        }
    }

    #[test]
    fn terms_of_a_holder_name_the_holder() {
        assert!(licence_text("LicenseRef-Ours", &["Example Lab".into()]).contains("Contact: Example Lab."));
    }
}

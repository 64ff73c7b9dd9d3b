//! SPDX licence expressions in a canonical form.

use super::LicenceError;
use spdx::ParseMode;
use spdx::expression::{ExprNode, Operator};
use std::collections::BTreeSet;
use std::fmt;

/// An expression with sorted operands, without repeats, and with brackets only where needed.
/// Precedence as in SPDX: `+`, WITH, AND, OR.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct LicenceExpression(LicenceTerm);

#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
enum LicenceTerm {
    /// A licence, with `+` and WITH if present.
    Licence(String),
    Any(BTreeSet<LicenceTerm>),
    All(BTreeSet<LicenceTerm>),
}

impl LicenceExpression {
    /// Parses an expression: ids of the SPDX list in their exact spelling, and `LicenseRef-` ids.
    ///
    /// # Errors
    /// The text is not an expression; it names a licence that is neither of these; or it names one
    /// that has no text in `LICENSES/`: `NOASSERTION`, terms in another document, or an id too long
    /// for a file name.
    pub fn parse(text: &str) -> Result<Self, LicenceError> {
        let refusal = |because: String| LicenceError { text: text.to_owned(), because };
        // SPDX keeps deprecated ids valid, and their texts exist.
        let mode = ParseMode { allow_deprecated: true, ..ParseMode::STRICT };
        let parsed = spdx::Expression::parse_mode(text, mode).map_err(|e| refusal(e.reason.to_string()))?;
        let mut stack = Vec::new();
        for node in parsed.iter() {
            let term = match node {
                ExprNode::Req(required) => {
                    let licence = required.req.to_string();
                    let unfit = licence.split(" WITH ").find_map(unfit_because);
                    unfit.map_or(Ok(LicenceTerm::Licence(licence)), |because| Err(refusal(because)))?
                }
                ExprNode::Op(operator) => {
                    // Postfix order: the second operand is on top.
                    let (Some(b), Some(a)) = (stack.pop(), stack.pop()) else {
                        return Err(refusal("an operator lacks an operand".into()));
                    };
                    LicenceTerm::join_terms(*operator, a, b)
                }
            };
            stack.push(term);
        }
        let term = stack.pop().ok_or_else(|| refusal("it is empty".into()))?;
        Ok(Self(term))
    }

    /// Returns the conjunction of all these expressions.
    ///
    /// # Panics
    /// The list is empty. Absent terms are not the same as free terms.
    #[must_use]
    pub fn conjunction_of(expressions: impl IntoIterator<Item = Self>) -> Self {
        let terms = expressions.into_iter().map(|e| e.0);
        let joined = terms.reduce(|a, b| LicenceTerm::join_terms(Operator::And, a, b));
        Self(joined.expect("a scene has at least one part"))
    }

    /// Returns the ids of its licences and exceptions, sorted. Their texts must be shipped.
    #[must_use]
    pub fn ids(&self) -> BTreeSet<String> {
        let mut ids = BTreeSet::new();
        self.0.collect_ids(&mut ids);
        ids
    }

    /// Returns true if every alternative contains this id.
    #[must_use]
    pub fn demands(&self, id: &str) -> bool {
        self.0.demands(id)
    }
}

impl LicenceTerm {
    fn join_terms(operator: Operator, a: Self, b: Self) -> Self {
        let mut terms = BTreeSet::new();
        for term in [a, b] {
            match (operator, term) {
                // Operands of the same operator are merged, so that equal expressions have equal
                // sets.
                (Operator::And, Self::All(inner)) | (Operator::Or, Self::Any(inner)) => terms.extend(inner),
                (_, term) => {
                    terms.insert(term);
                }
            }
        }
        if terms.len() == 1 {
            return terms.pop_first().expect("it has one element");
        }
        match operator {
            Operator::And => Self::All(terms),
            Operator::Or => Self::Any(terms),
        }
    }

    fn collect_ids(&self, ids: &mut BTreeSet<String>) {
        match self {
            // An exception has a text of its own, which is shipped too.
            Self::Licence(text) => ids.extend(text.split(" WITH ").map(|id| without_plus(id).to_owned())),
            Self::Any(terms) | Self::All(terms) => terms.iter().for_each(|t| t.collect_ids(ids)),
        }
    }

    fn demands(&self, id: &str) -> bool {
        match self {
            Self::Licence(text) => text.split(" WITH ").any(|part| without_plus(part) == id),
            Self::All(terms) => terms.iter().any(|t| t.demands(id)),
            Self::Any(terms) => terms.iter().all(|t| t.demands(id)),
        }
    }
}

/// Longest id, bytes. File systems accept names of 255 bytes, some encrypted ones of 143, and the
/// file of the text adds `.txt`.
const MAX_LENGTH: usize = 128;

/// Returns the reason why the id cannot name the terms of a release, if there is one.
fn unfit_because(id: &str) -> Option<String> {
    if id == "NOASSERTION" {
        Some("NOASSERTION states no terms".into())
    } else if id.starts_with("DocumentRef-") {
        Some(format!(
            "{id} is defined in another document, but a release must contain the texts of all its terms"
        ))
    } else if id.len() > MAX_LENGTH {
        Some(format!("an id has {} bytes, at most {MAX_LENGTH} can name the file of its text", id.len()))
    } else {
        None
    }
}

/// An id without the `+` that allows later versions.
fn without_plus(id: &str) -> &str {
    id.strip_suffix('+').unwrap_or(id)
}

impl fmt::Display for LicenceExpression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl fmt::Display for LicenceTerm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (terms, operator) = match self {
            Self::Licence(text) => return f.write_str(text),
            Self::All(terms) => (terms, " AND "),
            Self::Any(terms) => (terms, " OR "),
        };
        // Sorted as text, including brackets.
        let bracketed = |t: &LicenceTerm| match (self, t) {
            (Self::All(_), Self::Any(_)) => format!("({t})"),
            _ => t.to_string(),
        };
        let mut parts: Vec<String> = terms.iter().map(bracketed).collect();
        parts.sort();
        f.write_str(&parts.join(operator))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_expression_has_one_form() {
        let t = |text: &str, wanted: &str| {
            let found = LicenceExpression::parse(text).unwrap();
            assert_eq!(found.to_string(), wanted, "{text}");
            assert_eq!(LicenceExpression::parse(wanted).unwrap(), found, "{wanted}");
        };
        t("MIT", "MIT");
        t("MIT AND MIT", "MIT");
        t("MIT AND Apache-2.0 AND MIT", "Apache-2.0 AND MIT");
        t("MIT OR (Apache-2.0 OR MIT)", "Apache-2.0 OR MIT");
        t("MIT OR Apache-2.0 AND CC0-1.0", "Apache-2.0 AND CC0-1.0 OR MIT");
        t("(MIT OR Apache-2.0) AND CC0-1.0", "(Apache-2.0 OR MIT) AND CC0-1.0");
        t(
            "GPL-2.0-only WITH Classpath-exception-2.0 AND Apache-2.0+",
            "Apache-2.0+ AND GPL-2.0-only WITH Classpath-exception-2.0",
        );
    }

    #[test]
    fn what_is_no_licence_is_refused() {
        for text in ["CC BY MIT", "", "xyz-bad", "MIT AND", "MIT/Apache-2.0", "mit", "(MIT"] {
            let message = LicenceExpression::parse(text).unwrap_err().to_string();
            assert!(
                message.starts_with(&format!("`{text}` is not an SPDX licence expression: ")),
                "{message}"
            );
        }
    }

    #[test]
    fn ids_that_name_no_terms_of_their_own_are_refused() {
        let refused = |text: &str| LicenceExpression::parse(text).unwrap_err().because;
        for text in ["NOASSERTION", "MIT OR NOASSERTION", "(MIT OR NOASSERTION) AND CC0-1.0"] {
            assert_eq!(refused(text), "NOASSERTION states no terms", "{text}");
        }
        assert!(LicenceExpression::parse("NONE").is_err());
        for text in ["DocumentRef-x:LicenseRef-y", "MIT AND DocumentRef-x:LicenseRef-y"] {
            assert!(refused(text).contains("defined in another document"), "{text}");
        }
        let named = |letters: usize| format!("LicenseRef-{}", "x".repeat(letters));
        assert!(LicenceExpression::parse(&named(117)).is_ok());
        assert!(refused(&named(118)).contains("129 bytes"));
    }

    #[test]
    fn ids_are_those_whose_texts_bind() {
        let ids = |text: &str| LicenceExpression::parse(text).unwrap().ids().into_iter().collect::<Vec<_>>();
        assert_eq!(ids("MIT AND Apache-2.0+"), ["Apache-2.0", "MIT"]);
        assert_eq!(
            ids("GPL-2.0-only WITH Classpath-exception-2.0 OR MIT"),
            ["Classpath-exception-2.0", "GPL-2.0-only", "MIT"]
        );
    }

    #[test]
    fn an_alternative_does_not_demand() {
        let t = |text: &str, wanted| {
            assert_eq!(LicenceExpression::parse(text).unwrap().demands("CC-BY-NC-4.0"), wanted, "{text}");
        };
        t("CC-BY-NC-4.0", true);
        t("CC-BY-NC-4.0 AND MIT", true);
        t("CC-BY-NC-4.0 OR MIT", false);
        t("(CC-BY-NC-4.0 OR MIT) AND CC0-1.0", false);
        t("MIT", false);
    }
}

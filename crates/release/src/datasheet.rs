//! `DATASHEET.md`: the questions of "Datasheets for Datasets" (Gebru et al., Communications of the
//! ACM 64(12), 2021), in their order, answered from facts about the release. Unknown facts are
//! called unknown; nothing is made up.

mod answers;

use super::facts::ReleaseFacts;
use super::markdown::plain_text;
use answers::AnswerContext;
use std::fmt::Write as _;

/// Name of the file.
pub const NAME: &str = "DATASHEET.md";

/// Answer to questions that the publisher could answer and did not.
const UNSTATED: &str = "Not stated by the publisher.";

/// Answer to questions that cannot be answered.
const UNKNOWN: &str = "Not known.";

/// A question with its answer.
type DatasheetEntry = (&'static str, String);

/// Composes the file.
pub(super) fn compose_datasheet(facts: &ReleaseFacts<'_>) -> String {
    let info = facts.info;
    let mut text = format!("# Datasheet of {} {}\n\n", plain_text(&info.name), plain_text(&info.version));
    text.push_str(
        "The questions are those of Gebru et al., Datasheets for Datasets (2021). Answers are computed from the release, \
         or are the publisher's own words, which are marked as such.\n",
    );
    let answers = AnswerContext { facts, info };
    for (title, asked) in [
        ("Motivation", answers.motivation()),
        ("Composition", answers.composition()),
        ("Collection process", answers.collection()),
        ("Preprocessing, cleaning, labelling", answers.preprocessing()),
        ("Uses", answers.uses()),
        ("Distribution", answers.distribution()),
        ("Maintenance", answers.maintenance()),
    ] {
        let _ = write!(text, "\n## {title}\n");
        for (question, answer) in asked {
            let _ = write!(text, "\n**{question}**\n\n{}\n", answer.trim_end());
        }
    }
    text
}

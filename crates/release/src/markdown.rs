//! Texts in Markdown from templates, and texts of users in them.

use gs2e_files::escape;
use minijinja::syntax::SyntaxConfig;
use minijinja::{AutoEscape, Environment, UndefinedBehavior, Value};

/// The table of terms, which other templates include.
const TERMS: &str = include_str!("templates/terms.md.jinja");

/// Composes a text from a template. Texts among the values are escaped as by [`plain_text`], but for those
/// that are [`markup`].
///
/// # Panics
/// The template is wrong, or a value is missing.
pub(super) fn render(template: &str, values: Value) -> String {
    // A line of a template that ends with a backslash goes on in the next one.
    let [template, terms] = [template, TERMS].map(|text| text.replace("\\\n", ""));
    let mut templates = Environment::new();
    let lines =
        SyntaxConfig::builder().trim_blocks(true).lstrip_blocks(true).keep_trailing_newline(true).build();
    templates.set_syntax(lines.expect("the delimiters are the usual ones"));
    templates.set_undefined_behavior(UndefinedBehavior::Strict);
    templates.set_auto_escape_callback(|_| AutoEscape::Custom("markdown".into()));
    templates.set_formatter(|out, _, value| {
        match value.as_str().filter(|_| !value.is_safe()) {
            Some(text) => out.write_str(&plain_text(text))?,
            None => write!(out, "{value}")?,
        }
        Ok(())
    });
    let added = templates.add_template_owned("terms", terms);
    let text = added.and_then(|()| templates.render_str(&template, values));
    text.expect("templates and values belong to this program")
}

/// A text of this program, in which markup acts.
pub(super) fn markup(text: impl Into<String>) -> Value {
    Value::from_safe_string(text.into())
}

/// Text of a user on one line of Markdown. Nothing in it acts as markup or is hidden, wherever it
/// is put.
pub(super) fn plain_text(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.trim().chars() {
        match c {
            c if breaks_line(c) || c == '\t' => out.push(' '),
            // Two backslashes, which Markdown shows as one.
            c if escape::is_hidden(c) => out.push_str(&format!("\\{}", c.escape_unicode())),
            '\\' | '`' | '*' | '_' | '<' | '>' | '[' | ']' | '|' | '~' | '&' | '$' => out.extend(['\\', c]),
            c => out.push(c),
        }
    }
    if let Some(at) = opens_block(&out) {
        out.insert(at, '\\');
    }
    out
}

/// Returns true if readers of text take the character for the end of a line (Unicode UAX 14:
/// mandatory breaks).
pub(super) fn breaks_line(c: char) -> bool {
    matches!(c, '\n' | '\r' | '\u{b}' | '\u{c}' | '\u{85}' | '\u{2028}' | '\u{2029}')
}

/// Position at which a backslash keeps a line from opening a block: before the sign of a heading, a
/// list, a rule or an underline, or before the dot of `1. `.
fn opens_block(line: &str) -> Option<usize> {
    if line.starts_with(['#', '+', '-', '=']) {
        return Some(0);
    }
    let digits = line.bytes().take_while(u8::is_ascii_digit).count();
    let mut rest = line[digits..].chars();
    let marks = digits > 0 && rest.next().is_some_and(|c| c == '.' || c == ')');
    (marks && rest.next().is_none_or(char::is_whitespace)).then_some(digits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_users_are_no_markup() {
        let t = |text: &str, wanted: &str| assert_eq!(plain_text(text), wanted);
        t("Example Lab, 2025", "Example Lab, 2025");
        t(" a|b\n## Licence ", "a\\|b ## Licence");
        t("<img src=x> [a](b) `c` **d**", "\\<img src=x\\> \\[a\\](b) \\`c\\` \\*\\*d\\*\\*");
        t("~~~", "\\~\\~\\~");
        t("# X", "\\# X");
        t("- x", "\\- x");
        t("1. x 2. y", "1\\. x 2. y");
        t("12)", "12\\)");
        t("1.2.0", "1.2.0");
        t("===", "\\===");
        t("_x_ &lt; $y$", "\\_x\\_ \\&lt; \\$y\\$");
        t("a\r# X\u{2028}\u{1b}[31m\u{202e}", "a # X \\\\u{1b}\\[31m\\\\u{202e}");
    }
}

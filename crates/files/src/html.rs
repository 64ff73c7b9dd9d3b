//! HTML that is whole and inert by construction. The function that opens an element closes it, and
//! every text and every value of an attribute passes one escape. The page is XML as well, so that a
//! strict reader can judge it.

use crate::escape::{is_hidden, is_noncharacter};
use ct_codecs::{Base64, Encoder as _};
use sha2::{Digest as _, Sha256};
use std::fmt::Write as _;

/// The style sheet of all pages.
const STYLE: &str = include_str!("html/style.css");

/// Names and values of attributes. Names are written in this program; values may have any source.
type Attributes<'a> = &'a [(&'static str, &'a str)];

/// A piece of a page under construction.
#[derive(Debug, Default, Clone, PartialEq, Eq)]
pub struct HtmlFragment(String);

impl HtmlFragment {
    /// A whole page.
    pub fn whole_page(inside: impl FnOnce(&mut Self)) -> String {
        let mut page = Self("<!DOCTYPE html>\n".to_owned());
        page.within("html", &[("lang", "en")], inside);
        page.0.push('\n');
        page.0
    }

    /// An element and its content.
    pub fn within(&mut self, tag: &'static str, attributes: Attributes<'_>, inside: impl FnOnce(&mut Self)) {
        self.open(tag, attributes, ">");
        inside(self);
        self.0.push_str("</");
        self.0.push_str(tag);
        self.0.push('>');
        if BLOCKS.contains(&tag) {
            self.0.push('\n');
        }
    }

    /// An element with nothing but text in it.
    pub fn leaf(&mut self, tag: &'static str, attributes: Attributes<'_>, words: &str) {
        self.within(tag, attributes, |html| html.text(words));
    }

    /// An element that has no content: `img`, `meta`, and the shapes of a picture.
    pub fn empty(&mut self, tag: &'static str, attributes: Attributes<'_>) {
        self.open(tag, attributes, "/>");
    }

    /// Text.
    pub fn text(&mut self, words: &str) {
        escape_text(words, &mut self.0);
    }

    /// Text in which a pair of backticks encloses code. A backtick without a partner stays as it is.
    pub(crate) fn prose(&mut self, words: &str) {
        let mut pieces = words.split('`').peekable();
        let mut is_code = false;
        while let Some(piece) = pieces.next() {
            match (is_code, pieces.peek()) {
                (true, Some(_)) => self.leaf("code", &[], piece),
                (true, None) => self.text(&format!("`{piece}")),
                (false, _) => self.text(piece),
            }
            is_code = !is_code;
        }
    }

    /// An element with nothing but prose in it.
    pub fn prose_leaf(&mut self, tag: &'static str, attributes: Attributes<'_>, words: &str) {
        self.within(tag, attributes, |html| html.prose(words));
    }

    /// A table, in a box of its own that scrolls where the table is wider than the screen.
    pub fn table(&mut self, class: &'static str, inside: impl FnOnce(&mut Self)) {
        self.within("div", &[("class", "scroll")], |html| html.within("table", &[("class", class)], inside));
    }

    /// A row of large figures, each with its words.
    pub fn figures<'f>(&mut self, figures: impl IntoIterator<Item = (String, &'f str)>) {
        self.within("ul", &[("class", "figures-row")], |html| {
            for (figure, what) in figures {
                html.within("li", &[], |html| {
                    html.leaf("strong", &[], &figure);
                    html.text(&format!(" {what}"));
                });
            }
        });
    }

    /// The style sheet, which is part of this program and holds nothing that would need an escape.
    pub(crate) fn style(&mut self, sheet: &'static str) {
        assert!(!sheet.contains(['<', '&']), "a style sheet cannot be escaped");
        self.within("style", &[], |html| html.0.push_str(sheet));
    }

    /// Appends another piece.
    pub fn append(&mut self, piece: &Self) {
        self.0.push_str(&piece.0);
    }

    fn open(&mut self, tag: &'static str, attributes: Attributes<'_>, end: &str) {
        self.0.push('<');
        self.0.push_str(tag);
        // An empty class is not written.
        for (name, value) in attributes.iter().filter(|of| **of != ("class", "")) {
            self.0.push(' ');
            self.0.push_str(name);
            self.0.push_str("=\"");
            escape_text(value, &mut self.0);
            self.0.push('"');
        }
        self.0.push_str(end);
    }
}

/// Writes the head of a page: its title, the style sheet, and a policy that forbids the browser
/// everything else.
pub fn write_page_head(html: &mut HtmlFragment, title: &str) {
    html.empty("meta", &[("charset", "utf-8")]);
    // Before everything that it governs: a policy in a page holds for what follows it.
    html.empty("meta", &[("http-equiv", "Content-Security-Policy"), ("content", &content_policy())]);
    html.empty("meta", &[("name", "viewport"), ("content", "width=device-width, initial-scale=1")]);
    html.empty("meta", &[("name", "color-scheme"), ("content", "light dark")]);
    html.empty("meta", &[("name", "referrer"), ("content", "no-referrer")]);
    html.leaf("title", &[], title);
    html.style(STYLE);
}

/// The page's policy: a browser may show its pictures and apply its one style sheet.
fn content_policy() -> String {
    // By its hash, so that no other style has an effect. `base-uri` and `form-action` do not follow
    // `default-src`.
    let style = encode_base64(&Sha256::digest(STYLE.as_bytes()));
    format!(
        "default-src 'none'; style-src 'sha256-{style}'; img-src data:; base-uri 'none'; form-action 'none'"
    )
}

/// Base 64 with padding (RFC 4648, section 4).
pub fn encode_base64(bytes: &[u8]) -> String {
    Base64::encode_to_string(bytes).expect("the text fits into memory")
}

/// Elements after which a line ends, for readers of the source.
const BLOCKS: [&str; 12] =
    ["head", "title", "style", "body", "section", "article", "details", "table", "tr", "p", "ul", "figure"];

/// Writes text so that it can end no text and no quoted value. Characters that no page may hold
/// become U+FFFD. Characters that would reorder the text around them, or be unseen in it, are shown
/// by number.
fn escape_text(words: &str, out: &mut String) {
    let mut plain = 0;
    for (at, character) in words.char_indices() {
        let instead = match character {
            '&' => "&amp;",
            '<' => "&lt;",
            '>' => "&gt;",
            '"' => "&quot;",
            '\'' => "&#39;",
            // The two control characters that a page may hold in any text.
            '\t' | '\n' => continue,
            c if c.is_control() || is_noncharacter(c) => "\u{fffd}",
            c if is_hidden(c) => "",
            _ => continue,
        };
        out.push_str(&words[plain..at]);
        plain = at + character.len_utf8();
        if instead.is_empty() {
            write!(out, "[U+{:04X}]", u32::from(character)).expect("a String takes any text");
        } else {
            out.push_str(instead);
        }
    }
    out.push_str(&words[plain..]);
}

/// A path below the page's folder as an address. Every byte that could mean anything there is
/// percent-encoded.
pub fn link_address(path: &str) -> String {
    path.bytes().fold(String::with_capacity(path.len()), |mut out, byte| {
        match byte {
            // Without the colon, since `javascript:x` would be an address of its own.
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' | b'/' => {
                out.push(char::from(byte));
            }
            _ => write!(out, "%{byte:02X}").expect("a String takes any text"),
        }
        out
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const WICKED: [&str; 8] = [
        "<script>alert(1)</script>",
        "\"><img src=x onerror=alert(1)>",
        "' onmouseover='alert(1)",
        "a & b &amp; &#60;c",
        "]]> --> <!-- <![CDATA[ </style></p>",
        "\u{202e}gnp.exe\u{2066}\u{200f}\u{feff}",
        "nul \0 bell \u{7} escape \u{1b} next \u{85} end \u{ffff}",
        "two\nlines\tand a tab",
    ];

    /// The text and the value that a strict reader gets back.
    fn read_back(words: &str) -> [String; 2] {
        let page = HtmlFragment::whole_page(|html| html.leaf("p", &[("title", words)], words));
        let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
        let document = roxmltree::Document::parse_with_options(&page, options).unwrap();
        let elements: Vec<_> = document.descendants().filter(|n| n.is_element()).collect();
        let names: Vec<&str> = elements.iter().map(|n| n.tag_name().name()).collect();
        assert_eq!(names, ["html", "p"], "{page}");
        assert_eq!(elements[1].attributes().len(), 1, "{page}");
        [elements[1].text().unwrap(), elements[1].attribute("title").unwrap()].map(str::to_owned)
    }

    #[test]
    fn whatever_is_written_is_text() {
        for words in &WICKED[..5] {
            assert_eq!(read_back(words), [*words; 2]);
        }
        assert_eq!(read_back(WICKED[7]), [WICKED[7], "two lines and a tab"]);
    }

    #[test]
    fn what_reorders_is_shown_and_what_is_no_text_is_replaced() {
        assert_eq!(read_back(WICKED[5])[0], "[U+202E]gnp.exe[U+2066][U+200F][U+FEFF]");
        let [text, value] = read_back(WICKED[6]);
        assert_eq!(text, "nul \u{fffd} bell \u{fffd} escape \u{fffd} next \u{fffd} end \u{fffd}");
        assert_eq!(value, text);
    }

    #[test]
    fn pairs_of_backticks_are_code() {
        for (words, wanted) in [
            ("no code", "no code"),
            ("set `a: <1>` or `b`", "set <code>a: &lt;1&gt;</code> or <code>b</code>"),
            ("`a`", "<code>a</code>"),
            ("a lone ` stays", "a lone ` stays"),
            ("`a` and ` stays", "<code>a</code> and ` stays"),
        ] {
            let mut html = HtmlFragment::default();
            html.prose(words);
            assert_eq!(html.0, wanted);
        }
        let page =
            HtmlFragment::whole_page(|html| WICKED.iter().for_each(|words| html.prose_leaf("p", &[], words)));
        assert!(!page.contains("<script") && !page.contains("<img"), "{page}");
    }

    #[test]
    fn addresses_lead_to_paths_alone() {
        for (path, wanted) in [
            ("a/b-1/base/sharp/000000.png", "a/b-1/base/sharp/000000.png"),
            ("javascript:alert(1)", "javascript%3Aalert%281%29"),
            ("a b/100%?x#y", "a%20b/100%25%3Fx%23y"),
            ("räume", "r%C3%A4ume"),
        ] {
            assert_eq!(link_address(path), wanted);
        }
    }
}

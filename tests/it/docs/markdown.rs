//! Markdown, as far as the checks need it: lines of prose, blocks of code, headings and links.

/// A fenced block of code.
#[derive(Debug, PartialEq)]
pub(super) struct Block {
    /// Language after the fence.
    pub(super) language: String,
    pub(super) text: String,
    /// Line of the opening fence, from 1.
    pub(super) line: usize,
}

/// A page in its parts.
#[derive(Debug, Default)]
pub(super) struct Page {
    /// Lines outside of code, numbered from 1.
    pub(super) prose: Vec<(usize, String)>,
    pub(super) blocks: Vec<Block>,
}

impl Page {
    pub(super) fn parse(text: &str) -> Self {
        let mut page = Self::default();
        let mut open: Option<Block> = None;
        for (line, text) in text.lines().enumerate().map(|(i, text)| (i + 1, text)) {
            match (open.take(), text.trim_start().strip_prefix("```")) {
                (None, Some(language)) => {
                    open = Some(Block { language: language.trim().to_owned(), text: String::new(), line });
                }
                (Some(block), Some(_)) => page.blocks.push(block),
                (Some(mut block), None) => {
                    block.text.push_str(text);
                    block.text.push('\n');
                    open = Some(block);
                }
                (None, None) => page.prose.push((line, text.to_owned())),
            }
        }
        assert!(open.is_none(), "a block of code is not closed");
        page
    }

    /// Blocks in one of these languages.
    pub(super) fn blocks_in(&self, languages: &[&str]) -> impl Iterator<Item = &Block> {
        self.blocks.iter().filter(move |block| languages.contains(&block.language.as_str()))
    }

    /// Targets of links and images, each with its line.
    pub(super) fn links(&self) -> Vec<(usize, String)> {
        let mut links = Vec::new();
        for (number, line) in &self.prose {
            let mut rest = without_code(line);
            while let Some((_, after)) = rest.split_once("](") {
                let Some((target, tail)) = after.split_once(')') else { break };
                links.push((*number, target.split(' ').next().unwrap_or_default().to_owned()));
                rest = tail.to_owned();
            }
        }
        links
    }
}

/// A line with its code spans blanked. A link's text may be code; its target is not.
fn without_code(line: &str) -> String {
    line.split('`').enumerate().map(|(i, part)| if i % 2 == 0 { part } else { " " }).collect()
}

/// Anchor of a heading: lower case, letters, digits, `-` and `_`, and `-` for each space.
pub(super) fn slug(heading: &str) -> String {
    let kept = |c: &char| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_');
    heading.to_lowercase().chars().filter(kept).map(|c| if c == ' ' { '-' } else { c }).collect()
}

/// Commands of a shell block: lines joined at a backslash, comments left out, split into words.
pub(super) fn commands(block: &str) -> Vec<Vec<String>> {
    let joined = block.replace("\\\n", " ");
    joined.lines().map(words).filter(|words| !words.is_empty()).collect()
}

fn words(line: &str) -> Vec<String> {
    let (mut words, mut word, mut quote) = (Vec::new(), None::<String>, None);
    for c in line.chars() {
        match (quote, c) {
            (Some(open), c) if c == open => quote = None,
            (None, '\'' | '"') => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            (None, '#') if word.is_none() => break,
            (None, ' ') => words.extend(word.take()),
            (_, c) => word.get_or_insert_default().push(c),
        }
    }
    words.extend(word);
    words
}

/// Text in lines of at most 110 columns.
pub(super) fn wrapped(text: &str) -> String {
    let mut out = String::new();
    let mut column = 0;
    for word in text.split_whitespace() {
        let length = word.chars().count() + 1;
        if column + length > 110 {
            out.push('\n');
            column = 0;
        } else if column > 0 {
            out.push(' ');
        }
        out.push_str(word);
        column += length;
    }
    out
}

#[test]
fn pages_have_parts() {
    let page = Page::parse(
        "# A `b.c[]` d\nsee [x](README.md#z) and `[not](this)`\n```sh\ngs2e a \\\n  'b c' # d\n```\n# A `b.c[]` d\n",
    );
    assert_eq!(slug("A `b.c[]` d"), "a-bc-d");
    assert_eq!(page.links(), [(2, "README.md#z".to_owned())]);
    let block = page.blocks_in(&["sh"]).next().unwrap();
    assert_eq!((block.line, commands(&block.text)), (3, vec![vec!["gs2e".into(), "a".into(), "b c".into()]]));
    assert_eq!(page.prose.len(), 3);
}

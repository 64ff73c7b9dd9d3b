//! Source files as the rules see them: comments, the insides of literals and unit tests blanked,
//! lines kept.

use std::path::Path;

/// One file of the repository.
#[derive(Clone)]
pub(super) struct Source {
    /// Path from the repository's root, `/`-separated.
    pub(super) path: String,
    /// The file's own text.
    pub(super) text: String,
    /// For Rust, the code alone, with the same lines as `text`; for other files empty.
    pub(super) code: String,
}

impl Source {
    pub(super) fn new(path: &str, text: &str) -> Self {
        let is_rust = Path::new(path).extension().is_some_and(|ext| ext == "rs");
        let code = if is_rust { without_tests(&without_literals(text)) } else { String::new() };
        Self { path: path.to_owned(), text: text.to_owned(), code }
    }

    /// The folder of the modules that this one declares: `crates/scene/src` for the crate's root,
    /// `crates/scene/src/ply` for `crates/scene/src/ply.rs`.
    fn folder(&self) -> &str {
        folder_of(&self.path)
    }

    /// Files of the modules that this one declares as `#[cfg(test)] mod name;`.
    fn test_modules(&self) -> Vec<String> {
        let folder = self.folder();
        let marked = without_literals(&self.text);
        let items = marked.split(TEST_MARK).skip(1).map(|rest| &rest[..item_length(rest)]);
        let names = items.filter_map(|item| item.split_once("mod ")?.1.strip_suffix(';'));
        names.map(|name| format!("{folder}/{name}.rs")).collect()
    }

    /// Returns true if the source is one of these files or in the folder of one: `src/cli.rs`
    /// includes `src/cli/*`, and `crates/store/src/lib.rs` the whole crate.
    pub(super) fn is_in(&self, files: &[&str]) -> bool {
        files.iter().any(|file| {
            let in_folder = self.path.strip_prefix(folder_of(file)).is_some_and(|rest| rest.starts_with('/'));
            self.path == *file || in_folder
        })
    }

    /// The code's lines, numbered from 1.
    pub(super) fn lines(&self) -> impl Iterator<Item = (usize, &str)> {
        self.code.lines().enumerate().map(|(i, line)| (i + 1, line))
    }
}

/// The repository's root.
pub(super) fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The folder of the modules below a file.
fn folder_of(file: &str) -> &str {
    let file = file.trim_end_matches(".rs");
    ["/lib", "/main"].iter().find_map(|root| file.strip_suffix(root)).unwrap_or(file)
}

/// The files of the program and of its crates, sorted by path, without those that are only
/// compiled for tests.
pub(super) fn crate_sources() -> Vec<Source> {
    let mut sources = [read_below("crates"), read_below("src")].concat();
    let is_product = |path: &str| {
        path.ends_with(".rs") && format!("/{path}").contains("/src/") && !path.starts_with("crates/testing/")
    };
    sources.retain(|source| is_product(&source.path));
    let for_tests: Vec<String> = sources.iter().flat_map(Source::test_modules).collect();
    let for_tests: Vec<&str> = for_tests.iter().map(String::as_str).collect();
    sources.retain(|source| !source.is_in(&for_tests));
    sources
}

/// Every text file that is, or is meant to be, committed, sorted by path.
pub(super) fn committed_texts() -> Vec<Source> {
    read_below("")
}

fn read_below(folder: &str) -> Vec<Source> {
    const NOT_OURS: [&str; 5] = ["target", ".git", "out", ".gs2e", "__pycache__"];
    let ours = |entry: &walkdir::DirEntry| !NOT_OURS.contains(&entry.file_name().to_string_lossy().as_ref());
    walkdir::WalkDir::new(root().join(folder))
        .sort_by_file_name()
        .into_iter()
        .filter_entry(ours)
        .map(|entry| entry.expect("the repository can be walked"))
        .filter(|entry| entry.file_type().is_file())
        .filter_map(|entry| read(entry.path()))
        .collect()
}

/// `None` for files that are not UTF-8: images, scenes.
fn read(path: &Path) -> Option<Source> {
    let name =
        path.strip_prefix(root()).expect("it lies below the root").to_string_lossy().replace('\\', "/");
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{name}: {e}"));
    String::from_utf8(bytes).ok().map(|text| Source::new(&name, &text))
}

/// The text, with comments and the insides of string and character literals replaced by spaces.
fn without_literals(text: &str) -> String {
    let chars: Vec<char> = text.chars().collect();
    let mut out = String::with_capacity(text.len());
    let mut i = 0;
    while i < chars.len() {
        let end = opaque_end(&chars, i);
        match end {
            Some(end) => {
                out.extend(chars[i..end].iter().map(|c| if *c == '\n' { '\n' } else { ' ' }));
                i = end;
            }
            None => {
                out.push(chars[i]);
                i += 1;
            }
        }
    }
    out
}

/// The end of the comment or literal that begins at `i`, if one begins there.
fn opaque_end(chars: &[char], i: usize) -> Option<usize> {
    let starts = |prefix: &str| prefix.chars().eq(chars[i..].iter().copied().take(prefix.len()));
    let word_before = i > 0 && (chars[i - 1].is_alphanumeric() || chars[i - 1] == '_');
    let find = |from: usize, wanted: char| {
        chars[from.min(chars.len())..].iter().position(|c| *c == wanted).map(|n| from + n)
    };
    if starts("//") {
        return Some(find(i, '\n').unwrap_or(chars.len()));
    }
    if starts("/*") {
        return Some(block_comment_end(chars, i));
    }
    if starts("r\"") || starts("r#\"") || starts("r##\"") {
        return (!word_before).then(|| raw_string_end(chars, i));
    }
    if starts("\"") {
        return Some(escaped_end(chars, i + 1, '"'));
    }
    let is_char = starts("'\\") || (starts("'") && chars.get(i + 2) == Some(&'\''));
    is_char.then(|| escaped_end(chars, i + 1, '\''))
}

fn escaped_end(chars: &[char], mut i: usize, close: char) -> usize {
    while i < chars.len() && chars[i] != close {
        i += if chars[i] == '\\' { 2 } else { 1 };
    }
    (i + 1).min(chars.len())
}

fn raw_string_end(chars: &[char], i: usize) -> usize {
    let hashes = chars[i + 1..].iter().take_while(|c| **c == '#').count();
    let mut close = vec!['"'];
    close.resize(1 + hashes, '#');
    let body = i + 2 + hashes;
    let length = chars[body..].windows(close.len()).position(|window| window == close);
    length.map_or(chars.len(), |n| body + n + close.len())
}

fn block_comment_end(chars: &[char], mut i: usize) -> usize {
    let mut depth = 0;
    while i + 1 < chars.len() {
        match (chars[i], chars[i + 1]) {
            ('/', '*') => depth += 1,
            ('*', '/') => depth -= 1,
            _ => {
                i += 1;
                continue;
            }
        }
        i += 2;
        if depth == 0 {
            return i;
        }
    }
    chars.len()
}

const TEST_MARK: &str = "#[cfg(test)]";

/// The code with each item after `#[cfg(test)]` blanked. Literals are already blank, so braces
/// balance.
fn without_tests(code: &str) -> String {
    let mut rest = code;
    let mut out = String::with_capacity(code.len());
    while let Some(start) = rest.find(TEST_MARK) {
        let length = item_length(&rest[start + TEST_MARK.len()..]) + TEST_MARK.len();
        out.push_str(&rest[..start]);
        out.extend(rest[start..start + length].chars().map(|c| if c == '\n' { '\n' } else { ' ' }));
        rest = &rest[start + length..];
    }
    out.push_str(rest);
    out
}

/// Bytes up to the end of the item that `code` begins with: its closing brace, or a semicolon
/// before any brace.
fn item_length(code: &str) -> usize {
    let mut depth = 0;
    for (i, c) in code.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth == 1 => return i + 1,
            '}' => depth -= 1,
            ';' if depth == 0 => return i + 1,
            _ => {}
        }
    }
    code.len()
}

#[test]
fn code_excludes_comments_literals_and_tests() {
    let text = r##"//! println!("a")
use x; /* unsafe /* nested */ unsafe */ let s = "pri\"nt!"; let r = r#"HashMap " "#; let c = '"'; let l: &'a str;
#[cfg(test)]
mod tests {
    fn unsafe_fn() { let x = '}'; }
}
fn after() {}
"##;
    let source = Source::new("src/x.rs", text);
    assert_eq!(source.code.lines().count(), text.lines().count());
    let words: Vec<&str> = source.code.split_whitespace().collect();
    assert_eq!(words.join(" "), "use x; let s = ; let r = ; let c = ; let l: &'a str; fn after() {}");
}

#[test]
fn files_of_test_modules_are_known() {
    let text = "#[cfg(test)]\nmod planted;\n#[cfg(test)]\nmod tests { mod not_a_file; }\nmod code;";
    assert_eq!(Source::new("crates/check/src/lib.rs", text).test_modules(), ["crates/check/src/planted.rs"]);
    assert_eq!(Source::new("src/lib.rs", text).test_modules(), ["src/planted.rs"]);
}

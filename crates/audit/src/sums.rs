//! `SHA256SUMS` and `B3SUMS` in their one form: one line per file,
//! `<64 lower-case hexadecimal digits>  <path>`, sorted by path, with a final newline. Another form
//! can state the same sums (the case of a digit is one bit), but it is a fault nonetheless: the
//! program that wrote the file did not make that change.

use super::walk::unsafe_because;
use super::{AuditFault, FaultCode, TrustedTree};
use gs2e_files as files;
use gs2e_files::LinkRule;
use gs2e_release::checksum;
use std::collections::BTreeMap;
use std::path::Path;

/// Sums by path, as far as the file can be understood.
pub(super) type Sums = BTreeMap<String, String>;

/// Reads `SHA256SUMS`. Returns `None` if there is no text that files can be compared with.
pub(super) fn read_sums(dir: &Path, faults: &mut Vec<AuditFault>) -> Option<Sums> {
    read_named(dir, checksum::NAME, "the file is missing, so this is not a release", faults)
}

/// Reads `B3SUMS`, if its bytes are those that `SHA256SUMS` states. If they are not, it is reported
/// as an altered file like any other.
pub(super) fn read_b3(tree: &TrustedTree<'_>, sums: &Sums, faults: &mut Vec<AuditFault>) -> Option<Sums> {
    const ABSENT: &str = "every release has this file; SHA256SUMS does not list it";
    if tree.has(checksum::B3_NAME) {
        return read_named(tree.dir, checksum::B3_NAME, ABSENT, faults);
    }
    if !sums.contains_key(checksum::B3_NAME) {
        faults.push(AuditFault::of_file(FaultCode::Missing, checksum::B3_NAME, ABSENT));
    }
    None
}

fn read_named(dir: &Path, name: &str, absent: &str, faults: &mut Vec<AuditFault>) -> Option<Sums> {
    let mut fault = |code, message: String| faults.push(AuditFault::of_file(code, name, message));
    match files::read_with(&dir.join(name), LinkRule::Refuse, files::MAX_DOCUMENT).map(String::from_utf8) {
        Ok(Ok(text)) => return Some(parse_sums(name, &text, faults)),
        Ok(Err(e)) => fault(FaultCode::Altered, format!("it is not UTF-8 text: {}", e.utf8_error())),
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => fault(FaultCode::Missing, absent.into()),
        Err(e) => fault(FaultCode::Unreadable, e.to_string()),
    }
    None
}

fn parse_sums(name: &str, text: &str, faults: &mut Vec<AuditFault>) -> Sums {
    let mut sums = Sums::new();
    let mut altered = |message: String| faults.push(AuditFault::of_file(FaultCode::Altered, name, message));
    let mut previous: Option<&str> = None;
    for (number, line) in (1..).zip(text.split_inclusive('\n')) {
        let Some((sum, path)) = split_line(line) else {
            altered(format!(
                "line {number}: found {line:?}, wanted 64 lower-case hexadecimal digits, two spaces and a path"
            ));
            continue;
        };
        // A strict order also excludes two lines for one path.
        if previous.is_some_and(|previous| previous >= path) {
            altered(format!("line {number}: {path:?} is out of order or repeated"));
        }
        previous = Some(path);
        sums.insert(path.to_owned(), sum.to_owned());
    }
    let unsafe_paths = sums.keys().filter_map(|path| Some((path, unsafe_because(path)?)));
    faults.extend(
        unsafe_paths.map(|(path, because)| AuditFault::of_file(FaultCode::UnsafePath, path, because)),
    );
    // Files are opened by the paths of this list, so none of them may lead out of the tree.
    sums.retain(|path, _| unsafe_because(path).is_none());
    sums
}

/// The parts of a line with its newline; `None` for a line in another form.
fn split_line(line: &str) -> Option<(&str, &str)> {
    let (sum, path) = line.strip_suffix('\n')?.split_once("  ")?;
    let digits = sum.len() == 64 && sum.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
    (digits && !path.is_empty()).then_some((sum, path))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SUM: &str = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

    fn codes(text: &str) -> Vec<FaultCode> {
        let mut faults = Vec::new();
        parse_sums(checksum::NAME, text, &mut faults);
        faults.into_iter().map(|f| f.code).collect()
    }

    #[test]
    fn one_form_is_accepted() {
        assert_eq!(codes(&format!("{SUM}  a b\n{SUM}  c/d\n")), []);
    }

    #[test]
    fn any_other_form_is_a_fault() {
        let t = |text: String, wanted: &[FaultCode]| assert_eq!(codes(&text), wanted, "{text}");
        t(format!("{SUM}  a"), &[FaultCode::Altered]);
        t(format!("{SUM}  a\n\n"), &[FaultCode::Altered]);
        t(format!("{} a\n", SUM), &[FaultCode::Altered]);
        t(format!("{} *a\n", SUM), &[FaultCode::Altered]);
        t(format!("{}  a\n", SUM.to_uppercase()), &[FaultCode::Altered]);
        t(format!("{}  a\n", &SUM[1..]), &[FaultCode::Altered]);
        t(format!("{SUM}  b\n{SUM}  a\n"), &[FaultCode::Altered]);
        t(format!("{SUM}  a\n{SUM}  a\n"), &[FaultCode::Altered]);
        t(format!("{SUM}  ../a\n"), &[FaultCode::UnsafePath]);
    }
}

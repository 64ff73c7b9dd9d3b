//! Signed releases: `gs2e release --sign` and `gs2e audit --public-key`.

use crate::support::absent::not_run;
use crate::support::workspace::{TINY, Workspace};
use ct_codecs::{Base64, Encoder as _};
use minisign::KeyPair;
use serde_json::Value;
use std::fs;
use std::process::Command;

/// A workspace with the recipe, and with two pairs of keys without passwords: `a` and `b`.
fn place() -> Workspace {
    let place = Workspace::with_tiny();
    for name in ["a", "b"] {
        let pair = KeyPair::generate_unencrypted_keypair().unwrap();
        place.write(&format!("{name}.key"), pair.sk.to_box(None).unwrap().into_string());
        place.write(&format!("{name}.pub"), pair.pk.to_box().unwrap().into_string());
    }
    place
}

/// The codes of the faults, and the last record.
fn audit(place: &Workspace, args: &str) -> (i32, Vec<String>, Value) {
    let ended = place.gs2e(&format!("audit out --json {args}"));
    let mut records: Vec<Value> =
        ended.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let last = records.pop().unwrap();
    let codes = records.iter().map(|record| record["code"].as_str().unwrap().to_owned()).collect();
    (ended.code, codes, last)
}

const WRONG: &str = "signature-invalid";

#[test]
fn a_signature_holds_for_one_key_and_one_release() {
    let place = place();
    let said = place.ok("release --to out --sign a.key tiny.yaml").stderr;
    assert!(said.contains("signed out with the key "), "{said}");
    let (code, faults, last) = audit(&place, "--public-key a.pub");
    assert_eq!((code, faults.len(), last["verified"].as_bool()), (0, 0, Some(true)), "{last}");
    let base64 = fs::read_to_string(place.path("a.pub")).unwrap();
    let base64 = base64.lines().nth(1).unwrap();
    assert_eq!(audit(&place, &format!("--public-key {base64}")).0, 0);
    // Without a key the signature is a claim.
    let (code, _, last) = audit(&place, "");
    assert_eq!((code, last["verified"].as_bool()), (0, Some(false)));
    assert_eq!(last["signed_by"].as_str().map(str::len), Some(16));
    assert!(last["unproved"][0].as_str().unwrap().contains("claims a signature"), "{last}");
    assert_eq!(audit(&place, "--public-key b.pub").1, [WRONG]);
    // The same release keeps its signature, with the option and without.
    let before = fs::read(place.path("out/SHA256SUMS.minisig")).unwrap();
    assert!(place.ok("release --to out --sign a.key tiny.yaml").stderr.contains("already signed"));
    assert!(place.ok("release --to out tiny.yaml").stderr.contains("is up to date"));
    assert_eq!(fs::read(place.path("out/SHA256SUMS.minisig")).unwrap(), before);
    // Another release needs another signature, and the old one does not stay behind.
    place.write("tiny.yaml", TINY.replace("seed: 7", "seed: 8"));
    place.ok("release --to out tiny.yaml");
    assert!(!place.path("out/SHA256SUMS.minisig").exists());
    assert_eq!(audit(&place, "--public-key a.pub").1, [WRONG]);
    place.ok("release --to out --sign b.key tiny.yaml");
    assert_eq!(audit(&place, "--public-key b.pub").0, 0);
    // The signature of the earlier release does not fit.
    fs::write(place.path("out/SHA256SUMS.minisig"), before).unwrap();
    assert_eq!(audit(&place, "--public-key a.pub").1, [WRONG]);
}

/// The program of minisign's authors reads the signature too, where it is installed.
#[test]
fn minisign_accepts_the_signature() {
    if Command::new("minisign").arg("-v").output().is_err() {
        return not_run("minisign is absent");
    }
    let place = place();
    place.ok("release --to out --sign a.key tiny.yaml");
    let verify = |key: &str| {
        let mut command = Command::new("minisign");
        command.args(["-V", "-p", key, "-m", "out/SHA256SUMS"]).current_dir(place.path(""));
        command.output().unwrap().status.success()
    };
    assert!(verify("a.pub") && !verify("b.pub"));
}

#[test]
fn files_that_are_no_signatures_are_faults() {
    let place = place();
    place.ok("release --to out --sign a.key tiny.yaml");
    let path = place.path("out/SHA256SUMS.minisig");
    let right = fs::read_to_string(&path).unwrap();
    let lines: Vec<&str> = right.lines().collect();
    let t = |text: String| {
        fs::write(&path, &text).unwrap();
        for key in ["", "--public-key a.pub"] {
            let (code, faults, _) = audit(&place, key);
            assert_eq!((code, faults.as_slice()), (3, &[WRONG.to_owned()][..]), "{key}: {text:?}");
        }
    };
    t(String::new());
    t("junk\n".to_owned());
    t(format!("{right}more\n"));
    t(right.replace('\n', "\r\n"));
    // A last line of three bytes, and one of many.
    t(format!("{}\n{}\n{}\nAAAA\n", lines[0], lines[1], lines[2]));
    t(format!("{}\n{}\n{}\n{}\n", lines[0], lines[1], lines[2], lines[3].repeat(3)));
    t(format!("{}\nAAAA\n{}\n{}\n", lines[0], lines[2], lines[3]));
    // A signature that a person made is no reason to delete it.
    fs::write(&path, right.replace("gs2e release, SHA256SUMS", "mine")).unwrap();
    place.write("tiny.yaml", TINY.replace("seed: 7", "seed: 8"));
    let ended = place.gs2e("release --to out tiny.yaml");
    assert_eq!(ended.code, 2, "{}", ended.stderr);
    assert!(ended.stderr.contains("SHA256SUMS.minisig"), "{}", ended.stderr);
}

/// minisign 0.11 writes no checksum into a key without a password.
#[test]
fn a_key_without_a_checksum_signs() {
    let place = place();
    let mut bytes = KeyPair::generate_unencrypted_keypair().unwrap().sk.to_bytes();
    let end = bytes.len();
    bytes[end - 32..].fill(0);
    let key = Base64::encode_to_string(&bytes).unwrap();
    place.write("plain.key", format!("untrusted comment: minisign encrypted secret key\n{key}\n"));
    place.ok("release --to out --sign plain.key tiny.yaml");
    assert_eq!(audit(&place, "").2["signed_by"].as_str().map(str::len), Some(16));
}

#[test]
fn wrong_keys_are_refused_before_anything_runs() {
    let place = place();
    place.write("junk.key", "untrusted comment: x\njunk\n");
    let t = |key: &str, words: &str| {
        let ended = place.gs2e(&format!("release --to out --sign {key} tiny.yaml"));
        assert_eq!(ended.code, 2, "{key}: {}", ended.stderr);
        assert!(ended.stderr.contains(words), "{key}: {}", ended.stderr);
        assert!(!place.path(".gs2e").exists() && !place.path("out").exists(), "{key}");
    };
    t("gone.key", "gone.key");
    t("junk.key", "is not a usable secret key of minisign");
    place.write("short.key", "untrusted comment: x\nRWQAAEIy\n");
    t("short.key", "is not a usable secret key of minisign");
    t("a.pub", "is not a usable secret key of minisign");
    place.ok("release --to out --sign a.key tiny.yaml");
    let ended = place.gs2e("audit out --public-key a.key");
    assert_eq!(ended.code, 2, "{}", ended.stderr);
    assert!(ended.stderr.contains("is not a usable public key of minisign"), "{}", ended.stderr);
}

#[test]
fn a_full_audit_checks_and_rebuilds() {
    let place = place();
    place.ok("release --to out tiny.yaml");
    let said = place.ok("audit --full out --recipes tiny.yaml").stderr;
    assert!(said.contains("rebuilt: tiny") && said.contains("checks: "), "{said}");
    assert!(said.contains("0 faults in "), "{said}");
}

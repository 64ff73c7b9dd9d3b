//! Checks that the release is lawful, as far as the tree shows it (docs/design/pipeline.md,
//! "Licences").

use super::{AuditFault, FaultCode, TrustedTree};
use gs2e_files as files;
use gs2e_release::card::head::hub_licence;
use gs2e_release::manifest::{FileOwners, ReleaseManifest};
use gs2e_release::products::is_metadata;
use gs2e_release::scene::{LicensedTool, OWNER, SceneRecord};
use gs2e_release::{datasheet, loader, reuse};
use gs2e_source::kind::SourceKind;
use gs2e_source::licence::{LedgerAsset, LicenceError, LicenceExpression, ledger};
use gs2e_tree::ReleaseFiles as _;
use serde_json::Value;
use std::collections::BTreeSet;

/// Checks a scene's own terms, and what its source demands of them.
pub(super) fn scene_terms(
    scene: &SceneRecord,
    tree: &TrustedTree<'_>,
    owners: &FileOwners<'_>,
) -> Vec<AuditFault> {
    let fault = |code, message: String| AuditFault::of_scene(code, &scene.id, message);
    let text = scene.licence.expression.trim();
    if text.is_empty() {
        return vec![fault(FaultCode::LicenceMissing, "its scene.json has no licence expression".into())];
    }
    let expression = match LicenceExpression::parse(text) {
        Ok(expression) => expression,
        Err(e) => return vec![fault(FaultCode::LicenceInvalid, e.to_string())],
    };
    // Before the kind of the source is known, since photos are refused for every kind.
    let mut faults = photo_faults(scene, tree);
    let Some(kind) = SourceKind::by_name(&scene.source.kind) else {
        let message = format!("its source `{}` is not known", scene.source.kind);
        faults.push(fault(FaultCode::LicenceInvalid, message));
        return faults;
    };
    let upstream = ledger::find_dataset(kind, scene.source.upstream_url.as_deref());
    if let Some(asset) = upstream {
        faults.extend(demanded_terms(scene, asset, &expression));
    }
    if let Some(asset) = upstream.filter(|asset| asset.restricted()) {
        faults.extend(restricted_faults(scene, asset, tree, owners));
    }
    faults.extend(part_terms(scene, upstream, &expression));
    faults.extend(scene.licence.tools.iter().filter_map(|tool| of_tool(scene, tool)));
    faults
}

/// Checks that the terms demand the ids of the upstream. What the upstream granted instead applies
/// only with evidence, which the recipe must state as well.
fn demanded_terms(
    scene: &SceneRecord,
    asset: &LedgerAsset,
    expression: &LicenceExpression,
) -> Vec<AuditFault> {
    let fault = |message: String| AuditFault::of_scene(FaultCode::LicenceForbidden, &scene.id, message);
    let grants = scene.licence.parts.iter().filter(|part| part.asset == asset.name);
    let grant = grants.filter_map(|part| part.grant.as_ref()).next();
    let stated = scene.recipe.get("licence").and_then(|licence| licence.get("upstream"));
    let Some(grant) = grant else {
        let ids = asset.ids.iter().filter(|id| !expression.demands(id));
        let lacking = ids.map(|id| {
            fault(format!("its source {} requires {id}, its terms are `{expression}`", asset.name))
        });
        let unproven = stated
            .map(|terms| fault(format!("its recipe states {terms} for {}, without evidence", asset.name)));
        return lacking.chain(unproven).collect();
    };
    if let Some(lacks) = grant.lacks() {
        return vec![fault(format!(
            "the evidence for `{}` of {} has no {lacks}",
            grant.expression, asset.name
        ))];
    }
    let as_stated =
        serde_json::json!({ "granted_by": grant.granted_by, "url": grant.url, "date": grant.date });
    let evidence = scene.recipe.get("licence").and_then(|licence| licence.get("evidence"));
    if evidence != Some(&as_stated) || stated.and_then(Value::as_str) != Some(&grant.expression) {
        return vec![fault(format!("the evidence for `{}` is not in its recipe", grant.expression))];
    }
    match LicenceExpression::parse(&grant.expression) {
        Err(e) => vec![AuditFault::of_scene(FaultCode::LicenceInvalid, &scene.id, e.to_string())],
        Ok(granted) => {
            // An id in one alternative of an `OR` does not bind, so only demanded ids count.
            let ids = granted.ids().into_iter().filter(|id| granted.demands(id) && !expression.demands(id));
            ids.map(|id| fault(format!("the granted terms require {id}, its terms are `{expression}`")))
                .collect()
        }
    }
}

/// Checks that the terms of the parts together are those of the whole, and that the part of the
/// dataset states what the ledger has.
fn part_terms(
    scene: &SceneRecord,
    upstream: Option<&LedgerAsset>,
    whole: &LicenceExpression,
) -> Vec<AuditFault> {
    let path = format!("{}/scene.json", scene.id);
    let parsed: Result<Vec<LicenceExpression>, LicenceError> =
        scene.licence.parts.iter().map(|part| LicenceExpression::parse(&part.expression)).collect();
    let mut faults = Vec::new();
    match parsed {
        Err(e) => faults.push(AuditFault::of_scene(FaultCode::LicenceInvalid, &scene.id, e.to_string())),
        Ok(terms) if terms.is_empty() => {
            faults.push(AuditFault::of_scene(
                FaultCode::LicenceMissing,
                &scene.id,
                "its terms are not stated part by part",
            ));
        }
        Ok(terms) => {
            // A conjunction is sorted and has no repetitions, so the order of the parts has no
            // effect.
            let together = LicenceExpression::conjunction_of(terms);
            if together != *whole {
                let message =
                    format!("its terms are `{whole}`, those of its parts together are `{together}`");
                faults.push(AuditFault::of_file(FaultCode::ClaimsDisagree, &path, message));
            }
        }
    }
    for part in &scene.licence.parts {
        let asset = upstream.filter(|asset| asset.name == part.asset);
        let evidence = asset.iter().flat_map(|asset| asset.evidence).map(|evidence| evidence.url);
        let known = match asset {
            // The owner's part has no entry in the ledger, so it has no date of verification.
            None => part.asset == OWNER && part.verified.is_none(),
            Some(asset) => part.verified == Some(asset.verified) && part.obligations == asset.obligations,
        };
        if !known || !evidence.eq(part.evidence.iter().map(String::as_str)) {
            let message =
                format!("its statements on {} differ from the known terms of that source", part.asset);
            faults.push(AuditFault::of_file(FaultCode::ClaimsDisagree, &path, message));
        }
    }
    faults
}

/// Checks that a program's terms are an expression, and the right one if the ledger has the
/// program.
fn of_tool(scene: &SceneRecord, tool: &LicensedTool) -> Option<AuditFault> {
    let stated = match LicenceExpression::parse(&tool.licence) {
        Ok(stated) => stated,
        Err(e) => {
            return Some(AuditFault::of_scene(
                FaultCode::LicenceInvalid,
                &scene.id,
                format!("{}: {e}", tool.name),
            ));
        }
    };
    let id = ledger::find_tool(&tool.name)?.ids.iter().find(|id| !stated.demands(id))?;
    let message = format!("{} is under {id}, but scene.json states `{stated}`", tool.name);
    Some(AuditFault::of_scene(FaultCode::LicenceForbidden, &scene.id, message))
}

/// Reports upstream photos under any name. They are never passed on.
fn photo_faults(scene: &SceneRecord, tree: &TrustedTree<'_>) -> Vec<AuditFault> {
    let photos: BTreeSet<&str> = scene.images.iter().filter_map(|image| image.sha256.as_deref()).collect();
    let found = tree.intact.iter().filter(|(_, sha256)| photos.contains(*sha256));
    let message = "its SHA-256 is that of a photo of the source";
    found
        .map(|(path, _)| AuditFault::of_file(FaultCode::LicenceForbidden, path, message).in_scene(&scene.id))
        .collect()
}

/// Reports files derived from restricted material. They may exist only if the scene is gated and
/// the releaser gives a reason.
fn restricted_faults(
    scene: &SceneRecord,
    asset: &LedgerAsset,
    tree: &TrustedTree<'_>,
    owners: &FileOwners<'_>,
) -> Vec<AuditFault> {
    let mut faults = Vec::new();
    if !scene.licence.gated {
        let message = format!("its source {} must be gated, but the scene is not", asset.name);
        faults.push(AuditFault::of_scene(FaultCode::LicenceForbidden, &scene.id, message));
    }
    let reason = scene.licence.redistribution.as_deref().unwrap_or_default();
    // A withheld scene has no derived files, whatever reason is given.
    if !reason.trim().is_empty() && !scene.licence.withheld {
        return faults;
    }
    let folder = format!("{}/", scene.id);
    // A scene `a/b` lies in the folder of a scene `a`, and has terms of its own.
    let is_own = |path: &&str| owners.of(path).is_none_or(|owner| owner.id == scene.id);
    let derived = tree.below(&folder).filter(|path| !is_metadata(path)).filter(is_own);
    faults.extend(derived.map(|path| {
        let message =
            format!("it is derived from {}, and no reason to redistribute it is stated", asset.name);
        AuditFault::of_file(FaultCode::LicenceForbidden, path, message).in_scene(&scene.id)
    }));
    faults
}

/// Checks that each id in use has a text and no other text exists, and that the terms of the
/// release are those of its scenes together.
pub(super) fn text_faults(manifest: &ReleaseManifest, tree: &TrustedTree<'_>) -> Vec<AuditFault> {
    // An expression that is not valid is a fault of its scene.
    let parsed = manifest.scenes.iter().filter_map(|scene| LicenceExpression::parse(&scene.licence).ok());
    let expressions: Vec<LicenceExpression> = parsed.collect();
    let loader = tree.has(loader::NAME).then(loader::licence_ids).into_iter().flatten();
    let used: BTreeSet<String> = expressions.iter().flat_map(LicenceExpression::ids).chain(loader).collect();
    let name = |path: &str| Some(path.strip_prefix("LICENSES/")?.strip_suffix(".txt")?.to_owned());
    let shipped: BTreeSet<String> = tree.intact.keys().filter_map(|path| name(path)).collect();
    let path = |id: &String| format!("LICENSES/{id}.txt");
    let mut faults = Vec::new();
    for id in used.difference(&shipped) {
        faults.push(AuditFault::of_file(
            FaultCode::LicenceTextMissing,
            &path(id),
            "the licence is in use, but its text is missing or damaged",
        ));
    }
    for id in shipped.difference(&used) {
        faults.push(AuditFault::of_file(
            FaultCode::LicenceUnused,
            &path(id),
            "no file is under this licence",
        ));
    }
    // A conjunction of nothing panics.
    if !expressions.is_empty() {
        let whole = LicenceExpression::conjunction_of(expressions).to_string();
        if manifest.licence != whole {
            let message = format!(
                "its licence is `{}`, the licences of the scenes together are `{whole}`",
                manifest.licence
            );
            faults.push(AuditFault::of_file(
                FaultCode::ClaimsDisagree,
                gs2e_release::manifest::NAME,
                message,
            ));
        }
    }
    faults
}

/// Checks that `REUSE.toml` says of the files what the scenes say, and that datasheet and card state the
/// terms of the whole.
pub(super) fn repeated_terms(
    tree: &TrustedTree<'_>,
    manifest: &ReleaseManifest,
    scenes: &[SceneRecord],
) -> Vec<AuditFault> {
    let mut faults = Vec::new();
    // An absent file is reported with the names of files.
    let mut judge = |code, path: &str, problem: &dyn Fn(&str) -> Option<String>| {
        let text = tree.has(path).then(|| text_of(tree, path));
        let problem = text.and_then(|text| problem(&text));
        faults.extend(problem.map(|message| AuditFault::of_file(code, path, message)));
    };
    // Without all scenes the wanted text is not known.
    if scenes.len() == manifest.scenes.len() {
        let wanted = reuse::compose_reuse(&scenes.iter().collect::<Vec<_>>(), &manifest.licence);
        judge(FaultCode::ClaimsDisagree, reuse::NAME, &|text| {
            (text != wanted).then(|| "its statements on files differ from those of the scenes".to_owned())
        });
    }
    let whole = format!("The whole: `{}`.", manifest.licence);
    judge(FaultCode::ClaimsDisagree, datasheet::NAME, &|text| {
        (!text.contains(&whole)).then(|| "it states other terms than the manifest".to_owned())
    });
    judge(FaultCode::CardLicence, "README.md", &|text| card_problem(text, &manifest.licence));
    faults
}

/// The text of a file, or an empty one if the file is no text.
fn text_of(tree: &TrustedTree<'_>, path: &str) -> String {
    let text = tree.read(path, files::MAX_DOCUMENT).ok().and_then(|bytes| String::from_utf8(bytes).ok());
    text.unwrap_or_default()
}

/// Describes a head of the card that does not state the terms of the whole.
fn card_problem(text: &str, licence: &str) -> Option<String> {
    let value = |key: &str| text.lines().find_map(|line| line.strip_prefix(key));
    let (stated, wanted) = match hub_licence(licence) {
        Some(id) => (value("license: ").map(str::to_owned), id),
        None => {
            let name = value("license_name: ").and_then(|name| serde_json::from_str::<String>(name).ok());
            (name, licence.to_owned())
        }
    };
    let is_wrong = stated.as_ref() != Some(&wanted);
    let stated = stated.as_deref().unwrap_or("nothing");
    is_wrong.then(|| format!("its head says `{stated}`, the release is under `{licence}`"))
}

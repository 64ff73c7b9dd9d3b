//! A program that trains a scene.

use crate::field::Field;
use crate::problem::{FieldProblem, quote_text};
use crate::resolve::number::{RealRange, WholeRange};
use crate::resolve::{Resolver, all};
use crate::schema;
use crate::text::TextSpan;
use gs2e_source::reconstruct::{
    ArgumentError, ArgumentPlaces, ArgumentTemplate, GaussianCount, TrainerCommand,
};
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

const PROGRAM: &str = "write program: opensplat, a name to look up in PATH, or \"{train}\" with \
                       files: { train: path/to/it }";
const VERSION: &str = "write version: \"1.1.4\": it is part of the key, so that another version trains again";
const LICENCE: &str =
    "write licence: AGPL-3.0-only, the licence of the program; use LicenseRef-Name if it has no id";
const SCENE: &str = "write scene: scene.ply, the file below {out} that the program writes";
const NAME_HELP: &str = "names consist of a to z, 0 to 9, - and _";

/// Numbers of iterations and of Gaussians.
const NUMBER: WholeRange = WholeRange::new(1, 1_000_000_000);

/// Placeholders of arguments that are known when the recipe is read.
const SEED: &str = "seed";
const ITERATIONS: &str = "iterations";

/// Names that may occur in braces, with the known values.
type KnownNames<'k> = BTreeMap<&'k str, Option<String>>;

impl Resolver<'_> {
    pub(super) fn command(
        &self,
        raw: &schema::CommandSection,
        place: TextSpan,
        seed: Option<u64>,
    ) -> Option<TrainerCommand> {
        let files = self.files(&raw.files);
        let iterations = raw.iterations.optional(|iterations| self.whole(iterations, 0, NUMBER));
        // Names become known step by step: the program may refer to files, the version command also
        // to values of the recipe, and only the arguments to the folders of a training.
        let mut known: KnownNames<'_> =
            files.iter().flatten().map(|(name, _)| (name.as_str(), None)).collect();
        let program = self
            .required(&raw.program, "program", place, PROGRAM)
            .and_then(|(text, at)| self.program(text, at, &known));
        known.insert(SEED, Some(seed.unwrap_or_default().to_string()));
        if let Some(Some(iterations)) = iterations {
            known.insert(ITERATIONS, Some(iterations.to_string()));
        }
        let probe = raw.probe.optional(|probe| self.arguments(probe, &known));
        known.extend(ArgumentPlaces::ALL.map(|name| (name, None)));
        let arguments = self.arguments(&raw.arguments, &known);
        let version = self.required(&raw.version, "version", place, VERSION);
        let licence = self.required(&raw.licence, "licence", place, LICENCE);
        resolved!(TrainerCommand {
            program,
            arguments,
            version: version.and_then(|(text, at)| self.filled(text, at)),
            licence: licence.and_then(|(text, at)| self.tool_terms(raw.program.given()?.0, text, at)),
            environment: self.environment(&raw.environment),
            scene: raw.scene.optional(|scene| self.below_out(scene)),
            hold_out: raw.hold_out.optional(|every| self.small(every, 0, WholeRange::new(2, 1_000_000))),
            gaussians: self.limits(&raw.gaussians),
            min_psnr: self.real(&raw.min_psnr, TrainerCommand::MIN_PSNR_DB, RealRange::new(0.0, 100.0)),
            probe,
            files,
            iterations,
        })
    }

    /// A bare name or a placeholder for a file. A path would enter the key.
    fn program(&self, text: &str, place: TextSpan, known: &KnownNames<'_>) -> Option<ArgumentTemplate> {
        let program = self.argument(&self.filled(text, place)?, place, known)?;
        if text.contains(std::path::MAIN_SEPARATOR) {
            let problem = FieldProblem::of_field(format!("is {}, a path", quote_text(text)));
            return self.refuse(problem.help(PROGRAM).at(place));
        }
        Some(program)
    }

    fn arguments(
        &self,
        field: &Field<Vec<Field<String>>>,
        known: &KnownNames<'_>,
    ) -> Option<Vec<ArgumentTemplate>> {
        all(field.or_default()?, |item: Field<String>| {
            item.given().and_then(|(text, place)| self.argument(text, place, known))
        })
    }

    fn argument(&self, text: &str, place: TextSpan, known: &KnownNames<'_>) -> Option<ArgumentTemplate> {
        let names: Vec<&str> = known.keys().copied().collect();
        match ArgumentTemplate::parse(text, known) {
            Ok(_) if text.contains('\0') => self
                .refuse(FieldProblem::of_field("contains a NUL, which an argument cannot contain").at(place)),
            Ok(argument) => Some(argument),
            Err(ArgumentError::Unknown(name)) => {
                self.refuse(FieldProblem::unknown_name("placeholder", &name, &names).at(place))
            }
            Err(ArgumentError::Alone) => {
                let help = format!("placeholders here: {}; write a literal brace twice", names.join(", "));
                self.refuse(FieldProblem::of_field("has an unpaired brace").help(help).at(place))
            }
        }
    }

    fn files(&self, field: &Field<BTreeMap<String, Field<String>>>) -> Option<BTreeMap<String, PathBuf>> {
        all(field.or_default()?, |(name, path): (String, Field<String>)| {
            let (text, place) = path.given()?;
            self.refuse_name(&name, place)?;
            Some((name, self.folders[place.file as usize].join(self.filled(text, place)?)))
        })
    }

    fn refuse_name(&self, name: &str, place: TextSpan) -> Option<()> {
        let taken = ArgumentPlaces::ALL.contains(&name) || [SEED, ITERATIONS].contains(&name);
        let is_sound = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_".contains(c);
        if taken {
            let problem = FieldProblem::of_key("has a reserved name");
            return self.refuse(problem.help("choose another name").at(place));
        }
        if name.is_empty() || !name.chars().all(is_sound) {
            return self
                .refuse(FieldProblem::of_key("is not a valid name for a file").help(NAME_HELP).at(place));
        }
        Some(())
    }

    fn environment(
        &self,
        field: &Field<BTreeMap<String, Field<String>>>,
    ) -> Option<BTreeMap<String, String>> {
        all(field.or_default()?, |(name, value): (String, Field<String>)| {
            let (text, place) = value.given()?;
            if name.is_empty() || name.contains(['=', '\0']) || text.contains('\0') {
                return self.refuse(FieldProblem::of_key("is not a valid environment variable").at(place));
            }
            Some((name, text.clone()))
        })
    }

    /// Resolves the path of a file below `{out}`.
    fn below_out(&self, field: &Field<String>) -> Option<String> {
        let (text, place) = field.given()?;
        let text = self.filled(text, place)?;
        if !Path::new(&text).components().all(|part| matches!(part, Component::Normal(_))) {
            let problem =
                FieldProblem::of_field(format!("is {}, wanted a file below {{out}}", quote_text(&text)));
            return self.refuse(problem.help(SCENE).at(place));
        }
        Some(text)
    }

    fn limits(&self, field: &Field<schema::CountSection>) -> Option<GaussianCount> {
        let raw = field.or_default()?;
        let end = |field: &Field<u64>| field.optional(|end| self.whole(end, 0, NUMBER));
        resolved!(GaussianCount { min: end(&raw.min), max: end(&raw.max) })
    }
}

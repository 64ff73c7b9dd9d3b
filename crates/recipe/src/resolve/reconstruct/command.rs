//! A program that trains a scene.

use crate::field::Field;
use crate::problem::{FieldProblem, quote_text};
use crate::resolve::Resolver;
use crate::resolve::number::{RealRange, WholeRange};
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

/// Placeholders of arguments that are known when the recipe is read.
const SEED: &str = "seed";
const ITERATIONS: &str = "iterations";

/// Names that may occur in braces, with the known values.
type Known<'k> = BTreeMap<&'k str, Option<String>>;

impl Resolver<'_> {
    pub(super) fn command(
        &self,
        raw: &schema::CommandSection,
        place: TextSpan,
        seed: Option<u64>,
    ) -> Option<TrainerCommand> {
        let files = self.files(&raw.files);
        let iterations = self.iterations(&raw.iterations);
        // Names become known step by step: the program may refer to files, the version command also
        // to values of the recipe, and only the arguments to the folders of a training.
        let mut known: Known<'_> = files.iter().flatten().map(|(name, _)| (name.as_str(), None)).collect();
        let program = self
            .required(&raw.program, "program", place, PROGRAM)
            .and_then(|(text, at)| self.program(text, at, &known));
        known.insert(SEED, Some(seed.unwrap_or_default().to_string()));
        if let Some(Some(iterations)) = iterations {
            known.insert(ITERATIONS, Some(iterations.to_string()));
        }
        let probe = match &raw.probe {
            Field::Absent => Some(None),
            field => self.arguments(field, &known).map(Some),
        };
        known.extend(ArgumentPlaces::ALL.map(|name| (name, None)));
        let arguments = self.arguments(&raw.arguments, &known);
        let version = self.required(&raw.version, "version", place, VERSION);
        let version = version.and_then(|(text, at)| self.filled(text, at));
        let licence = self.required(&raw.licence, "licence", place, LICENCE);
        let licence = licence.and_then(|(text, at)| self.tool_terms(raw.program.given()?.0, text, at));
        let environment = self.environment(&raw.environment);
        let scene = self.below_out(&raw.scene);
        let hold_out = match &raw.hold_out {
            Field::Absent => Some(None),
            field => self.small(field, 0, WholeRange::new(2, 1_000_000)).map(Some),
        };
        let gaussians = self.limits(&raw.gaussians);
        let min_psnr = self.real(&raw.min_psnr, TrainerCommand::MIN_PSNR_DB, RealRange::new(0.0, 100.0));
        Some(TrainerCommand {
            program: program?,
            arguments: arguments?,
            version: version?,
            environment: environment?,
            scene: scene?,
            hold_out: hold_out?,
            gaussians: gaussians?,
            min_psnr: min_psnr?,
            probe: probe?,
            files: files?,
            licence: licence?,
            iterations: iterations?,
        })
    }

    /// A bare name or a placeholder for a file. A path would enter the key.
    fn program(&self, text: &str, place: TextSpan, known: &Known<'_>) -> Option<ArgumentTemplate> {
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
        known: &Known<'_>,
    ) -> Option<Vec<ArgumentTemplate>> {
        let none = Vec::new();
        let list = self.section(field, &none)?;
        let read: Vec<Option<ArgumentTemplate>> = list
            .iter()
            .map(|item| item.given().and_then(|(text, place)| self.argument(text, place, known)))
            .collect();
        read.into_iter().collect()
    }

    fn argument(&self, text: &str, place: TextSpan, known: &Known<'_>) -> Option<ArgumentTemplate> {
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
        let none = BTreeMap::new();
        let mut files = Some(BTreeMap::new());
        for (name, path) in self.section(field, &none)? {
            let found = path.given().and_then(|(text, place)| {
                self.refuse_name(name, place)?;
                Some(self.folders[place.file as usize].join(self.filled(text, place)?))
            });
            // The loop goes on after a fault, so that every file is judged.
            match (&mut files, found) {
                (Some(files), Some(path)) => drop(files.insert(name.clone(), path)),
                _ => files = None,
            }
        }
        files
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
        let none = BTreeMap::new();
        let variable = |(name, value): (&String, &Field<String>)| {
            let (text, place) = value.given()?;
            if name.is_empty() || name.contains(['=', '\0']) || text.contains('\0') {
                return self.refuse(FieldProblem::of_key("is not a valid environment variable").at(place));
            }
            Some((name.clone(), text.clone()))
        };
        let read: Vec<_> = self.section(field, &none)?.iter().map(variable).collect();
        read.into_iter().collect()
    }

    /// Resolves the path of a file below `{out}`.
    fn below_out(&self, field: &Field<String>) -> Option<Option<String>> {
        let Some((text, place)) = field.given() else { return field.is_absent().then_some(None) };
        let text = self.filled(text, place)?;
        if !Path::new(&text).components().all(|part| matches!(part, Component::Normal(_))) {
            let problem =
                FieldProblem::of_field(format!("is {}, wanted a file below {{out}}", quote_text(&text)));
            return self.refuse(problem.help(SCENE).at(place));
        }
        Some(Some(text))
    }

    fn iterations(&self, field: &Field<u64>) -> Option<Option<u64>> {
        match field {
            Field::Absent => Some(None),
            field => self.whole(field, 0, WholeRange::new(1, 1_000_000_000)).map(Some),
        }
    }

    fn limits(&self, field: &Field<schema::CountSection>) -> Option<GaussianCount> {
        let absent = schema::CountSection::default();
        let raw = self.section(field, &absent)?;
        let end = |field: &Field<u64>| match field {
            Field::Absent => Some(None),
            field => self.whole(field, 0, WholeRange::new(1, 1_000_000_000)).map(Some),
        };
        let (min, max) = (end(&raw.min), end(&raw.max));
        Some(GaussianCount { min: min?, max: max? })
    }
}

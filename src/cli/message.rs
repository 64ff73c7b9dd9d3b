//! A message in four parts: the failure, its place, its causes, and a remedy.

use gs2e_files::escape;
use gs2e_recipe::RecipePosition;
use serde_json::json;
use std::path::Path;

/// The severity of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum MessageLevel {
    /// Something was not done.
    #[default]
    Error,
    /// The program goes on.
    Warning,
    /// The program goes on later.
    Waiting,
}

/// A message with a stable code.
#[derive(Debug, Clone, Default)]
pub(super) struct UserMessage {
    level: MessageLevel,
    code: &'static str,
    what: String,
    scene: Option<String>,
    step: Option<String>,
    /// The file that the message is about.
    path: Option<String>,
    /// The position in a recipe that names the subject of the message.
    named_at: Option<RecipePosition>,
    /// More about the failure and its place, one entry per line.
    details: Vec<String>,
    why: Vec<String>,
    help: Option<String>,
}

impl UserMessage {
    /// A message about something that was not done.
    pub(super) fn error(code: &'static str, what: impl Into<String>) -> Self {
        Self { code, what: what.into(), ..Self::default() }
    }

    /// A message while the program goes on.
    pub(super) fn warning(code: &'static str, what: impl Into<String>) -> Self {
        Self { level: MessageLevel::Warning, ..Self::error(code, what) }
    }

    /// A message before the program goes on.
    pub(super) fn waiting(code: &'static str, what: impl Into<String>) -> Self {
        Self { level: MessageLevel::Waiting, ..Self::error(code, what) }
    }

    /// Sets the scene that the message is about.
    pub(super) fn scene(self, scene: &str) -> Self {
        Self { scene: Some(scene.to_owned()), ..self }
    }

    /// Sets the step that the message is about.
    pub(super) fn step(self, scene: &str, step: &str) -> Self {
        Self { step: Some(step.to_owned()), ..self.scene(scene) }
    }

    /// Sets the file that the message is about.
    pub(super) fn path(self, path: &Path) -> Self {
        Self { path: Some(escape::path(path)), ..self }
    }

    /// Sets the position in a recipe that names the subject of the message.
    pub(super) fn named_at(self, at: Option<RecipePosition>) -> Self {
        Self { named_at: at, ..self }
    }

    /// Adds a line about the failure or its place. A line that begins with a space continues the
    /// line before it.
    pub(super) fn detail(self, line: impl Into<String>) -> Self {
        self.details([line.into()])
    }

    /// Adds lines as [`UserMessage::detail`] does.
    pub(super) fn details(mut self, lines: impl IntoIterator<Item = String>) -> Self {
        self.details.extend(lines);
        self
    }

    /// Adds lines of another program, each as a part of the line before it.
    pub(super) fn quote(self, lines: impl IntoIterator<Item = impl std::fmt::Display>) -> Self {
        self.details(lines.into_iter().map(|line| format!("  {line}")))
    }

    /// Adds a cause. The nearest cause is added first.
    pub(super) fn because(mut self, why: impl std::fmt::Display) -> Self {
        self.why.push(why.to_string());
        self
    }

    /// Sets the remedy.
    pub(super) fn help(self, help: impl Into<String>) -> Self {
        Self { help: Some(help.into()), ..self }
    }

    /// The scene and the step, or nothing, and the failure in one line.
    pub(super) fn step_and_what(&self) -> (&str, &str, &str) {
        let [scene, step] = [&self.scene, &self.step].map(|part| part.as_deref().unwrap_or_default());
        (scene, step, &self.what)
    }

    /// The lines for people.
    pub(super) fn to_lines(&self) -> Vec<String> {
        let word = match self.level {
            MessageLevel::Error => "error",
            MessageLevel::Warning => "warning",
            MessageLevel::Waiting => "waiting",
        };
        let mut lines = vec![format!("{word}: {}", self.what)];
        lines.extend(self.place().map(|place| format!(" {place}")));
        lines.extend(self.details.iter().map(|line| format!(" {line}")));
        lines.extend(self.why.iter().map(|why| format!(" because {why}")));
        lines.extend(self.help.iter().map(|help| format!("help: {help}")));
        lines
    }

    fn place(&self) -> Option<String> {
        match (&self.path, &self.named_at) {
            (Some(path), Some(at)) => Some(format!("{path}, named at {at}")),
            (Some(path), None) => Some(path.clone()),
            (None, Some(at)) => Some(at.to_string()),
            (None, None) => None,
        }
    }

    /// The object for programs, with null for absent parts. `line` and `column` are a position in a
    /// recipe, and `path` is then that recipe.
    pub(super) fn to_json(&self) -> serde_json::Value {
        let level = if self.level == MessageLevel::Error { "error" } else { "warning" };
        let at = self.named_at.as_ref();
        // `path` is the recipe then, so the file goes into the text.
        let other = self.path.as_ref().filter(|_| at.is_some());
        let message = std::iter::once(&self.what).chain(other).chain(&self.details).chain(&self.why);
        let message = message.fold(String::new(), |mut all, part| {
            // A line that begins with a space belongs to the line before it, and keeps its line
            // break.
            let joint = if all.is_empty() {
                ""
            } else if part.starts_with(' ') {
                "\n"
            } else {
                ": "
            };
            all.extend([joint, part]);
            all
        });
        json!({
            "level": level, "code": self.code, "message": message,
            "scene": self.scene, "step": self.step,
            "path": at.map(|at| &at.file).or(self.path.as_ref()),
            "line": at.map(|at| at.line), "column": at.map(|at| at.column),
            "help": self.help,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn whole() -> UserMessage {
        let at = RecipePosition { file: "recipes/a.yaml".into(), line: 5, column: 22 };
        UserMessage::error("input-missing", "a/b: the source is not there")
            .step("a/b", "capture")
            .path(Path::new("data/b"))
            .named_at(Some(at))
            .because("open data/b: no such file")
            .help("a path is relative to the recipe's folder")
    }

    #[test]
    fn four_parts_stand_below_one_another() {
        let wanted = "error: a/b: the source is not there\n data/b, named at recipes/a.yaml:5:22\n \
                      because open data/b: no such file\nhelp: a path is relative to the recipe's folder";
        assert_eq!(whole().to_lines().join("\n"), wanted);
        assert_eq!(UserMessage::waiting("locked", "x").to_lines(), ["waiting: x"]);
    }

    #[test]
    fn programs_get_all_fields_and_the_cause_in_the_message() {
        let value = whole().to_json();
        let fields = ["level", "code", "message", "scene", "step", "path", "help"];
        let wanted = [
            "error",
            "input-missing",
            "a/b: the source is not there: data/b: open data/b: no such file",
            "a/b",
            "capture",
            "recipes/a.yaml",
            "a path is relative to the recipe's folder",
        ];
        assert_eq!(fields.map(|field| value[field].as_str()), wanted.map(Some));
        assert_eq!([&value["line"], &value["column"]], [&json!(5), &json!(22)]);
        let bare = UserMessage::warning("x", "y").to_json();
        assert!(
            ["scene", "step", "path", "line", "column", "help"].iter().all(|field| bare[field].is_null())
        );
    }
}

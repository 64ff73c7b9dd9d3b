"""`gs2e schema` accepts the recipes that the program accepts, and rejects faults of shape."""

import json
import math
import pathlib
import random
import re
import subprocess
import sys

import pytest

import gs2e

ROOT = pathlib.Path(__file__).parents[2]
FIXTURES = ROOT / "crates/recipe/tests/fixtures/recipes"

SOUND = """\
version: 1
scene: a
source: { procedural: {} }
trajectories: [{ name: base, refine: {} }]
"""

# Broken recipes whose fault no JSON Schema can state.
BEYOND = {
    "text of YAML, before there are values": ["duplicate-key", "duplicate-key-inside", "not-nfc"],
    "a grammar": ["licence-unknown", "speed-name", "speed-not-positive", "speed-syntax"],
    "names or numbers that are compared": [
        "esim-spread", "floor-order", "novel-base-unknown", "novel-few-poses", "novel-names", "sensor-impossible",
        "v2e-impossible",
    ],
    "a missing key, which the defaults file may have": [
        "k-without-units", "reconstruct-missing", "source-none-camera", "threshold-without-preset",
    ],
}


@pytest.fixture(scope="module")
def schema(program, tmp_path_factory):
    path = tmp_path_factory.mktemp("schema") / "recipe.schema.json"
    path.write_text(program("schema").stdout)
    return path


@pytest.fixture(scope="module")
def rejected(schema):
    """The names of the files that check-jsonschema rejects. It reads YAML 1.2, as the program does."""
    pytest.importorskip("check_jsonschema")

    def run(paths):
        words = ["-m", "check_jsonschema", "-o", "json", "--schemafile", schema, *paths]
        done = subprocess.run([sys.executable, *words], capture_output=True, text=True)
        assert done.returncode in (0, 1), done.stderr
        told = json.loads(done.stdout)
        return {pathlib.Path(error["filename"]).name for error in told["errors"]}

    return run


@pytest.fixture(scope="module")
def validator(schema):
    jsonschema = pytest.importorskip("jsonschema")
    content = json.loads(schema.read_text())
    jsonschema.Draft202012Validator.check_schema(content)
    return jsonschema.Draft202012Validator(content)


def is_accepted(path):
    try:
        return bool(gs2e.read_recipes(path))
    except gs2e.RecipeError:
        return False


def test_valid_recipes_are_accepted(rejected, tmp_path):
    """The shipped recipes, and every example of the documentation that is a recipe or can become one."""
    blocks = [
        block
        for page in sorted((ROOT / "docs").rglob("*.md"))
        for block in re.findall(r"^```yaml\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)
    ]
    texts = [(ROOT / "recipes" / name).read_text() for name in ("demo.yaml", "paper-scale.yaml")]
    for block in blocks:
        # An example that shows some keys takes the others from the sound recipe.
        shown = set(re.findall(r"^(\w+):", block, re.MULTILINE))
        parts = [line for line in SOUND.splitlines(True) if line.split(":")[0] not in shown]
        texts += [block, "".join(parts) + block]
    valid = []
    for number, text in enumerate(texts):
        path = tmp_path / f"{number:03d}.yaml"
        path.write_text(text)
        if is_accepted(path):
            valid.append(path)
        else:
            path.unlink()
    assert len(valid) >= 15, "most examples are recipes"
    assert rejected(valid) == set()


@pytest.mark.parametrize(
    "change",
    [
        "colour: red",
        "camera: { width: 64 }",
        "camera: { width: wide, height: 48 }",
        "camera: { width: -1, height: 48 }",
        "camera: { width: 64, height: 100000 }",
        "sensor: { voltmetr: {} }",
        "sensor: { voltmeter: { presett: dvs346 } }",
        "sensor: { voltmeter: { preset: dvs347 } }",
        "sensor: { voltmeter: { preset: dvs346, k: [5.3, 20, 0.1, 0.1, 0.1, 0.1] } }",
        "sensor: { esim: {}, v2e: {} }",
        "sensor: { esim: { threshold: { on: { unifrom: [1, 2] } } } }",
        "sensor: { esim: {} }\nsensors: { a: { esim: {} } }",
        "outputs: [events, sharpp]",
        "outputs: [events, events]",
        "render: { background: [0, 0] }",
        "render: { antialiased: maybe }",
        "sampling: { rate: 0 }",
        "checks: { waive: [{ check: drift }] }",
        "checks: { speeed: { arc: 1 } }",
        "reconstruct: { given: { path: a.ply } }",
    ],
)
def test_faults_of_shape_are_rejected(change, rejected, tmp_path):
    (tmp_path / "faulty.yaml").write_text(SOUND + change + "\n")
    (tmp_path / "sound.yaml").write_text(SOUND)
    assert rejected([tmp_path / "faulty.yaml", tmp_path / "sound.yaml"]) == {"faulty.yaml"}
    assert not is_accepted(tmp_path / "faulty.yaml")


def test_most_broken_recipes_are_rejected(rejected):
    # Files that are broken as text are for the parser; one of them is a bomb, which most parsers do not survive.
    paths = [path for path in FIXTURES.glob("*.yaml") if not path.name.startswith("syntax-")]
    beyond = {f"{name}.yaml" for names in BEYOND.values() for name in names}
    names = {path.name for path in paths}
    assert beyond <= names, "the table names files that exist"
    found = rejected(paths)
    assert not found & beyond, "what is rejected can be stated"
    stated = names - beyond
    print(f"{len(found)} of {len(stated)} broken recipes are rejected; missed: {sorted(stated - found)}")
    assert len(stated) > 70 and len(found) >= 0.9 * len(stated)


class Invention:
    """Random values that fit a schema, but for its relations. No number of a sensor is a law."""

    TEXTS = ("a", "base", "lab/one", "x.ply", "https://example.org/a", "2025-06-01", "CC0-1.0", "1 + t", "5", "1/2", "2 s")
    # Texts with a grammar.
    HINTS = {
        "expression": "CC0-1.0", "licence": "MIT", "upstream": "CC-BY-4.0", "function": "1 + t", "base": "base",
        "factor": "7/2", "duration": "20 ms", "rate": "30000/1001", "scale": "scene", "date": "2025-06-01",
        "accessed": "2025-06-01", "program": "train", "scene_file": "a.ply",
    }

    def __init__(self, content, seed):
        self.content, self.random = content, random.Random(seed)

    def value(self, schema, depth=0):
        pick = self.random.choice
        if "$ref" in schema:
            return self.value(self.content["$defs"][schema["$ref"].rsplit("/", 1)[1]], depth)
        if "oneOf" in schema:
            return self.value(pick(schema["oneOf"]), depth)
        if "anyOf" in schema:
            return self.value(schema["anyOf"][0], depth)
        if "const" in schema:
            return schema["const"]
        if "enum" in schema:
            return pick(schema["enum"])
        kind = schema.get("type")
        if isinstance(kind, list):
            kind = pick(kind)
        return getattr(self, "a_" + kind)(schema, depth) if kind else {}

    def a_object(self, schema, depth):
        properties = schema.get("properties", {})
        wanted = set(schema.get("required", ()))
        others = [key for key, part in properties.items() if key not in wanted and part != {"not": {}} and "not" not in part]
        wanted.update(key for key in others if self.random.random() < 2 / (2 + len(others)) + 0.1)
        for rule in schema.get("allOf", ()):
            if "oneOf" in rule:
                choices = [choice["required"][0] for choice in rule["oneOf"]]
                wanted = wanted - set(choices) | {self.random.choice(choices)}
            apart = sorted(rule.get("not", {}).get("required", ()))
            if apart and wanted.issuperset(apart):
                wanted.remove(self.random.choice(apart))
        made = {key: self.value(properties[key], depth + 1) for key in properties if key in wanted}
        made.update((key, text) for key, text in self.HINTS.items() if isinstance(made.get(key), str))
        if isinstance(schema.get("additionalProperties"), dict):
            made["one"] = self.value(schema["additionalProperties"], depth + 1)
        return made

    def a_array(self, schema, depth):
        least = schema.get("minItems", 0)
        count = self.random.randint(least, min(schema.get("maxItems", least + 2), least + 2))
        return [self.value(schema["items"], depth + 1) for _ in range(count)]

    def a_integer(self, schema, depth):
        low, high = schema.get("minimum", 0), min(schema.get("maximum", 10**6), 10**15)
        return self.random.choice([low, high, self.random.randint(low, high), min(low + 3, high)])

    def a_number(self, schema, depth):
        low = schema.get("minimum", schema.get("exclusiveMinimum", -1e3))
        high = schema.get("maximum", abs(low) + 1e3)
        if "exclusiveMinimum" in schema:
            low = math.nextafter(low, high) if low else 1e-9
        return self.random.choice([low, high, self.random.uniform(low, high), min(max(low, 1.0), high)])

    def a_string(self, schema, depth):
        fitting = [text for text in self.TEXTS if re.search(schema.get("pattern", ""), text)]
        return self.random.choice(fitting)

    def a_boolean(self, schema, depth):
        return self.random.random() < 0.5


SHAPE = re.compile(
    r"unknown (field|choice|preset)|missing field|wanted a (mapping|list|text)|is the (text|single word)|wanted (true|a number|a whole number)"
    r"|is a list of|has no value|takes no value|is an empty list|has \d+ keys|no check is named|a limit is|not supported yet"
)
# A key that is missing may come from the defaults file, so the schema does not ask for it. A text in the place of a number,
# such as 1/2, has a range of its own.
MAY_BE = re.compile(r'missing field "[^"]*(reconstruct|camera|units|orbit|floor|evidence)|wanted a number.* such as')


def test_what_the_schema_accepts_is_not_refused_for_its_shape(validator, tmp_path):
    content = validator.schema
    accepted, read, wrong = 0, 0, []
    path = tmp_path / "recipe.yaml"
    for seed in range(1500):
        invention = Invention(content, seed)
        recipe = invention.value({key: part for key, part in content.items() if key != "allOf"})
        for key in ("scene", "source", "trajectories"):
            recipe.setdefault(key, invention.value(content["properties"][key]))
        if not validator.is_valid(recipe):
            continue
        accepted += 1
        path.write_text(json.dumps(recipe))
        try:
            gs2e.read_recipes(path)
            read += 1
        except gs2e.RecipeError as error:
            wrong += [fault.message for fault in error.faults if SHAPE.search(fault.message) and not MAY_BE.search(fault.message)]
    print(f"{accepted} inventions fit the schema, {read} of them are recipes")
    assert accepted > 300
    assert wrong == []

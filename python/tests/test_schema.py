"""`gs2e schema` accepts the recipes that the program accepts, and rejects faults of shape."""

import json
import pathlib

import pytest

ROOT = pathlib.Path(__file__).parents[2]
FIXTURES = ROOT / "tests/fixtures/recipes"


@pytest.fixture(scope="module")
def faults(program):
    jsonschema = pytest.importorskip("jsonschema")
    yaml = pytest.importorskip("yaml")
    schema = json.loads(program("schema").stdout)
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    loader = type("Loader", (yaml.SafeLoader,), {})
    # PyYAML reads YAML 1.1, where `on` and `off` are truth values. In YAML 1.2, as in the program, they are texts.
    resolvers = yaml.SafeLoader.yaml_implicit_resolvers
    loader.yaml_implicit_resolvers = {
        first: [(tag, pattern) for tag, pattern in found if tag != "tag:yaml.org,2002:bool" or first in "tTfF"]
        for first, found in resolvers.items()
    }
    return lambda text: [error.message for error in validator.iter_errors(yaml.load(text, loader))]


def test_the_shipped_recipes_are_accepted(faults):
    for name in ("demo.yaml", "paper-scale.yaml"):
        assert faults((ROOT / "recipes" / name).read_text()) == [], name


SOUND = """\
version: 1
scene: a
source: { procedural: {} }
trajectories: [{ name: base, refine: {} }]
"""


def test_a_sound_recipe_is_accepted(faults):
    assert faults(SOUND) == []


@pytest.mark.parametrize(
    "change",
    [
        "colour: red",
        "camera: { width: 64 }",
        "camera: { width: wide, height: 48 }",
        "camera: { width: -1, height: 48 }",
        "sensor: { voltmetr: {} }",
        "sensor: { voltmeter: { presett: dvs346 } }",
        "sensor: { esim: {}, v2e: {} }",
        "sensor: { esim: {} }\nsensors: { a: { esim: {} } }",
        "outputs: [events, sharpp]",
        "render: { background: [0, 0] }",
        "render: { antialiased: maybe }",
        "checks: { waive: [{ check: drift }] }",
    ],
)
def test_faults_of_shape_are_rejected(change, faults):
    assert faults(SOUND + change + "\n") != []

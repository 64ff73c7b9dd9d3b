"""Recipes: read, checked and written as by the program."""

from __future__ import annotations

import json
import os
import tempfile
from typing import Any, Iterable, Mapping

from gs2e import _native


def read_recipes(paths: str | os.PathLike | Iterable[str | os.PathLike]) -> list[dict[str, Any]]:
    """Reads recipes, files or folders, and returns each in full with all defaults, as in `scene.json`.

    A wrong recipe raises `RecipeError`, with file, line, column and help.
    """
    if isinstance(paths, (str, os.PathLike)):
        paths = [paths]
    return [json.loads(text) for text in _native.read_recipes([os.fspath(path) for path in paths])]


def write_recipe(path: str | os.PathLike, recipe: Mapping[str, Any]) -> dict[str, Any]:
    """Checks a recipe and writes it as YAML. Returns it in full with all defaults.

    Paths in the recipe are relative to the folder of `path`, and the defaults.yaml there applies. A wrong recipe
    raises `RecipeError`, and nothing is written; a file that is there is replaced in one step.
    """
    path = os.fspath(path)
    folder, name = os.path.split(path)
    if os.path.splitext(name)[1] not in (".yaml", ".yml"):
        raise ValueError(f"{path} is not the name of a recipe, wanted NAME.yaml")
    text = "".join(line + "\n" for line in _block(recipe, ""))
    # In the same folder, since the meaning of a recipe depends on it. A name with a dot is no recipe for others.
    number, partial = tempfile.mkstemp(prefix=".", suffix=".yaml", dir=folder or ".")
    try:
        with os.fdopen(number, "w", encoding="utf-8") as file:
            file.write(text)
        [full] = read_recipes(partial)
        os.chmod(partial, 0o644)
        os.replace(partial, path)
    except BaseException:
        os.unlink(partial)
        raise
    return full


def _block(value: Mapping[str, Any], indent: str) -> Iterable[str]:
    """The lines of a mapping: one per key, and a list of mappings with one entry per line."""
    for key, part in value.items():
        if isinstance(part, Mapping) and any(isinstance(deeper, (Mapping, list)) for deeper in part.values()):
            yield f"{indent}{key}:"
            yield from _block(part, indent + "  ")
        elif isinstance(part, (list, tuple)) and any(isinstance(entry, Mapping) for entry in part):
            yield f"{indent}{key}:"
            yield from (f"{indent}  - {_flow(entry)}" for entry in part)
        else:
            yield f"{indent}{key}: {_flow(part)}"


def _flow(value: Any) -> str:
    """A value on one line: JSON, which YAML contains."""
    return json.dumps(value, ensure_ascii=False, allow_nan=False)

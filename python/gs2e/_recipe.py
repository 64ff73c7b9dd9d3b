"""Recipes: read and checked as by the program."""

from __future__ import annotations

import json
import os
from typing import Any, Iterable

from gs2e import _native


def read_recipes(paths: str | os.PathLike | Iterable[str | os.PathLike]) -> list[dict[str, Any]]:
    """Reads recipes, files or folders, and returns each in full with all defaults, as in `scene.json`.

    A wrong recipe raises `RecipeError`, with file, line, column and help.
    """
    if isinstance(paths, (str, os.PathLike)):
        paths = [paths]
    return [json.loads(text) for text in _native.read_recipes([os.fspath(path) for path in paths])]

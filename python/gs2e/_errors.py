"""Exceptions of the module."""

from __future__ import annotations

import json
from typing import NamedTuple


class Fault(NamedTuple):
    """A fault of a recipe."""

    message: str
    file: str | None
    line: int | None
    """From 1; None if the fault concerns the whole file."""
    column: int | None
    """From 1, in characters."""
    help: str | None


class RecipeError(ValueError):
    """A recipe, or the sensor of one, is wrong.

    `file`, `line`, `column` and `help` are those of the first fault. `faults` has all of them, at most 20; `more` is
    the number of the others.
    """

    def __init__(self, text: str, faults: str = "[]", more: int = 0):
        super().__init__(text, faults, more)
        self.faults = [
            Fault(fault["message"], fault["path"], fault["line"], fault["column"], fault["help"])
            for fault in json.loads(faults)
        ]
        self.more = more

    def __str__(self) -> str:
        return self.args[0]

    @property
    def file(self) -> str | None:
        return self.faults[0].file if self.faults else None

    @property
    def line(self) -> int | None:
        return self.faults[0].line if self.faults else None

    @property
    def column(self) -> int | None:
        return self.faults[0].column if self.faults else None

    @property
    def help(self) -> str | None:
        return self.faults[0].help if self.faults else None


# Users catch `gs2e.RecipeError`, so that is its name in messages.
RecipeError.__module__ = "gs2e"

"""The build backend of the wheel: maturin's, after the program was built.

The wheel has two products of the workspace: the program `gs2e` and the module `gs2e._native`. maturin builds one of
them. The program is a program of its own, and no Python function that calls into the module, so that its signals,
exit codes and start-up time are the same as those of `cargo install`: Python would handle SIGINT and SIGPIPE itself,
and the program starts its own file again to supervise other programs.
"""

import json
import os
import shlex
import shutil
import subprocess
import sys

from maturin import *  # noqa: F403: the hooks of the backend
import maturin

_ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
_SCRIPTS = os.path.join(_ROOT, "target", "wheel", "scripts")


def prepare_metadata_for_build_wheel(metadata_directory, config_settings=None):
    # The metadata does not depend on the program, but maturin looks for the folder.
    os.makedirs(_SCRIPTS, exist_ok=True)
    return maturin.prepare_metadata_for_build_wheel(metadata_directory, config_settings)


prepare_metadata_for_build_editable = prepare_metadata_for_build_wheel


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    build_program(maturin.get_maturin_pep517_args(config_settings))
    return maturin.build_wheel(wheel_directory, config_settings, metadata_directory)


def build_editable(wheel_directory, config_settings=None, metadata_directory=None):
    build_program(maturin.get_maturin_pep517_args(config_settings))
    return maturin.build_editable(wheel_directory, config_settings, metadata_directory)


def build_program(arguments):
    """Builds the program with the profile of the module, and puts it where maturin packs scripts."""
    chosen = _chosen(arguments)
    profile = chosen.get("profile", "release")
    command = [os.environ.get("CARGO", "cargo"), "build", "--locked", "--bin", "gs2e"]
    # Both packages are named, so that shared crates have the features of the module and are compiled once.
    command += ["--package", "gs2e", "--package", "gs2e-python"]
    command += ["--profile", profile, "--message-format", "json-render-diagnostics"]
    if "target" in chosen:
        command += ["--target", chosen["target"]]
    built = subprocess.run(command, cwd=_ROOT, check=True, stdout=subprocess.PIPE, text=True)
    shutil.rmtree(_SCRIPTS, ignore_errors=True)
    os.makedirs(_SCRIPTS)
    shutil.copy(_executable(built.stdout), _SCRIPTS)


def _chosen(arguments):
    """The options of maturin that the program shares, by name."""
    chosen = {}
    words = iter(arguments)
    for word in words:
        name, _, value = word.lstrip("-").partition("=")
        if word.startswith("--") and name in ("profile", "target"):
            chosen[name] = value or next(words)
    return chosen


def _executable(messages):
    """The path that cargo names for the program."""
    found = [message for message in map(json.loads, messages.splitlines()) if message.get("executable")]
    return next(message["executable"] for message in found if message["target"]["name"] == "gs2e")


if __name__ == "__main__":
    # Before a plain `maturin build`: `python python/backend.py [--profile dev]`.
    build_program(shlex.split(os.environ.get("MATURIN_PEP517_ARGS", "")) + sys.argv[1:])

"""What comes from outside is never run, and never grows beyond bounds."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import cable_shape as cs

ROOT = Path(cs.__file__).parents[1]
RUN_WHAT_THEY_READ = {"pickle", "shelve", "dill", "cloudpickle", "joblib"}
CALLS = {"eval", "exec", "compile", "__import__"}
CALLS |= {"os.system", "os.popen", "yaml.load", "yaml.unsafe_load", "yaml.full_load"}
#: What a file that does any of it has in its text; only such files are looked at.
SUSPECT = re.compile(
    r"\b(?:pickle|shelve|dill|cloudpickle|joblib|eval|exec|compile|__import__|popen|system|load|shell)"
)


def suspects(folder: str) -> Iterator[tuple[Path, ast.Module]]:
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    texts = ((file, file.read_text(encoding="utf-8")) for file in files)
    return ((file, ast.parse(text)) for file, text in texts if SUSPECT.search(text))


def test_no_source_runs_what_it_reads() -> None:
    looked_at = 0
    for file, tree in suspects("cable_shape"):
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                assert not {alias.name.split(".")[0] for alias in node.names} & RUN_WHAT_THEY_READ, file
            elif isinstance(node, ast.ImportFrom):
                assert (node.module or "").split(".")[0] not in RUN_WHAT_THEY_READ, file
            elif isinstance(node, ast.Call):
                called = ast.unparse(node.func) if isinstance(node.func, ast.Name | ast.Attribute) else ""
                assert called not in CALLS, file
                given = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords if called == "np.load"}
                assert called != "np.load" or given.get("allow_pickle") == "False", file
                looked_at += 1
    assert looked_at > 100


@pytest.mark.parametrize("folder", ["cable_shape", "benchmarks", "demo", "soak", "examples", "test", "launch"])
def test_no_command_goes_through_a_shell(folder: str) -> None:
    for file, tree in suspects(folder):
        for node in ast.walk(tree):
            if isinstance(node, ast.keyword) and node.arg == "shell":
                assert isinstance(node.value, ast.Constant), file
                assert node.value.value is False, file

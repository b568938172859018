"""What comes from outside is never run, and never grows beyond bounds."""

import ast
from pathlib import Path

import pytest

import cable_shape as cs

ROOT = Path(cs.__file__).parents[1]
SOURCES = sorted(Path(cs.__file__).parent.rglob("*.py"))
RUN_WHAT_THEY_READ = {"pickle", "shelve", "dill", "cloudpickle", "joblib"}
CALLS = {"eval", "exec", "compile", "__import__"}


@pytest.mark.parametrize("file", SOURCES, ids=lambda file: str(file.relative_to(SOURCES[0].parent)))
def test_no_source_runs_what_it_reads(file):
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            assert not {alias.name.split(".")[0] for alias in node.names} & RUN_WHAT_THEY_READ
        elif isinstance(node, ast.ImportFrom):
            assert (node.module or "").split(".")[0] not in RUN_WHAT_THEY_READ
        elif isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            assert called not in CALLS
            assert called not in {"os.system", "os.popen", "yaml.load", "yaml.unsafe_load", "yaml.full_load"}
            given = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
            assert given.get("shell", "False") == "False"
            assert called != "np.load" or given.get("allow_pickle") == "False"


@pytest.mark.parametrize("folder", ["cable_shape", "benchmarks", "demo", "soak", "examples", "test", "launch"])
def test_no_command_goes_through_a_shell(folder):
    files = sorted((ROOT / folder).rglob("*.py"))
    assert files
    for file in files:
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Call):
                given = {keyword.arg: ast.unparse(keyword.value) for keyword in node.keywords}
                assert given.get("shell", "False") == "False", file

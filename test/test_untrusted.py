"""What comes from outside is never run, and never grows beyond bounds."""

import ast
from pathlib import Path

import pytest

import cable_shape as cs
from cable_shape.files import MAX_BYTES, load_yaml

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


def test_yaml_makes_no_objects(tmp_path):
    file = tmp_path / "cable.yaml"
    file.write_text("length: !!python/object/apply:os.system ['true']\n")
    with pytest.raises(cs.ArgumentError, match="could not determine a constructor"):
        load_yaml(file)


def test_a_small_file_that_stands_for_a_huge_one_is_refused(tmp_path):
    file = tmp_path / "cable.yaml"
    rows = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    rows += [f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 12)]
    file.write_text("\n".join(rows))
    with pytest.raises(cs.ArgumentError, match=r"aliases .* make more than 5000000 values"):
        cs.Cable.from_yaml(file)
    file.write_text("length: &a [*a]\n")
    with pytest.raises(cs.ArgumentError, match="aliases"):
        cs.Cable.from_yaml(file)


def test_aliases_may_still_be_used(tmp_path):
    file = tmp_path / "cable.yaml"
    file.write_text("length: &one 1.0\nlinear_density: 0.1\nbending_stiffness: [*one, *one]\n")
    assert cs.Cable.from_yaml(file).bending_stiffness == (1.0, 1.0)


def test_a_file_that_is_too_long_is_not_read(tmp_path):
    file = tmp_path / "cable.yaml"
    with file.open("wb") as opened:
        opened.truncate(MAX_BYTES + 1)
    with pytest.raises(cs.ArgumentError, match=f"at most {MAX_BYTES} are read"):
        load_yaml(file)

"""Who may import whom, read from the imports themselves: data flow one way."""

import ast
import importlib.util
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "pido"

MAY_IMPORT = {
    "core": set(),
    "physics": {"core"},
    "nc": {"core", "physics"},
    "process": {"core", "physics", "nc"},
    "recordings": {"core"},
    "store": {"core"},
    "feature_space": {"core"},
    "equations": {"core", "feature_space"},
    "sampling": {"core", "physics", "feature_space", "equations"},
    "models": {"core", "feature_space"},
    "monitoring": {"core", "models"},
    "diagnosis": {"core", "physics", "feature_space", "equations"},
    "synthetic": {"core", "physics", "nc", "process", "config"},
}
ONLY_HOME = {
    "prefect": {"flows", "benchmarks/plant"},
    "mlflow": {"pido/tracking", "benchmarks/plant", "benchmarks/chaos"},
    "sklearn": {
        "pido/models",
        "pido/experiments",
        "pido/diagnosis",
        "pido/sampling",
        "pido/equations",
        "pido/monitoring",
        "benchmarks",
    },
}


def _modules(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*.py"))


def _imports(path: Path) -> set[str]:
    """Absolute names of everything that a module imports, relative imports resolved."""
    package = ".".join(path.relative_to(ROOT).with_suffix("").parts[:-1])
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = (
                importlib.util.resolve_name("." * node.level + (node.module or ""), package)
                if node.level
                else (node.module or "")
            )
            names.add(base)
            names |= {f"{base}.{alias.name}" for alias in node.names}
    return names


@pytest.mark.parametrize("layer", MAY_IMPORT)
def test_a_layer_imports_only_the_layers_that_it_builds_on(layer):
    allowed = MAY_IMPORT[layer] | {layer}
    for path in _modules(PACKAGE / layer):
        own = {name.split(".")[1] for name in _imports(path) if name.startswith("pido.")}
        strangers = {name for name in own if (PACKAGE / name).exists() or (PACKAGE / f"{name}.py").exists()} - allowed
        assert not strangers, f"{path.relative_to(ROOT)} imports {sorted(strangers)}"


@pytest.mark.parametrize("library", ONLY_HOME)
def test_a_server_or_model_library_is_imported_only_in_its_home(library):
    for path in [*_modules(PACKAGE), *_modules(ROOT / "flows"), *_modules(ROOT / "benchmarks")]:
        if any(name.split(".")[0] == library for name in _imports(path)):
            place = path.relative_to(ROOT).as_posix()
            assert any(place.startswith(home) for home in ONLY_HOME[library]), place


def test_nobody_but_experiments_and_the_demo_uses_the_synthetic_machine():
    for path in [*_modules(PACKAGE), *_modules(ROOT / "flows")]:
        place = path.relative_to(ROOT).as_posix()
        if place.startswith(("pido/synthetic", "pido/experiments", "pido/cli/experiment", "flows/demo")):
            continue
        assert not any(name.startswith("pido.synthetic") for name in _imports(path)), place


@pytest.mark.parametrize(("generator", "other"), [("stranger", "newcomer"), ("newcomer", "stranger")])
def test_a_generator_of_cases_shares_no_formula_with_what_it_examines_nor_with_another_one(generator, other):
    for path in _modules(ROOT / "benchmarks" / generator):
        names = _imports(path)
        own = {name for name in names if name.startswith("pido.")}
        assert all(name.startswith(("pido.core", "pido.recordings", "pido.experiments")) for name in own), path.name
        assert not any(name.startswith(f"benchmarks.{other}") for name in names), path.name


def test_every_layer_of_the_table_exists():
    assert {layer for layer in MAY_IMPORT if not (PACKAGE / layer).is_dir()} == set()

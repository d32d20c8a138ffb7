"""Style of the public API, and the direction of imports between packages."""

import ast
import importlib
import inspect
import re
from pathlib import Path

import pytest

import occjax

PACKAGES = (
    "ops",
    "io",
    "layout",
    "evaluation",
    "models",
    "estimators",
    "results",
    "training",
    "data.procedural",
    "viewer",
    "viz",
)

POSITIONAL = {"concatenate", "mean_and_variance"}
"""Called by the volumes with two positional arguments, as a user's own function would be."""

NO_RUNNABLE_EXAMPLE = {"occjax.models.fetch_published_weights", "occjax.training.train"}
"""Functions whose example would download a file or train for a minute."""


def public_objects():
    for name in ("occjax", *(f"occjax.{package}" for package in PACKAGES)):
        module = importlib.import_module(name)
        for attribute in module.__all__:
            value = getattr(module, attribute)
            value = inspect.unwrap(value)  # a function that is compiled by jax.jit
            if inspect.isfunction(value) or inspect.isclass(value):
                yield f"{name}.{attribute}", value


OBJECTS = dict(public_objects())
FUNCTIONS = {name: value for name, value in OBJECTS.items() if inspect.isfunction(value)}

objects = pytest.mark.parametrize("name", OBJECTS)
functions = pytest.mark.parametrize("name", FUNCTIONS)


def section(value, title):
    """Text of one section of a docstring, empty if there is none."""
    found = re.search(rf"^{title}:\n((?:    .*\n?|\n)+)", inspect.getdoc(value) or "", re.MULTILINE)
    return found.group(1) if found else ""


@objects
def test_docstring_begins_with_a_sentence(name):
    first_line = (inspect.getdoc(OBJECTS[name]) or "").split("\n")[0]
    assert re.fullmatch(r"[A-Z`].*\.", first_line)


@functions
def test_arguments_and_result_are_described_and_annotated(name):
    function = FUNCTIONS[name]
    signature = inspect.signature(function)
    described = re.findall(r"^    \*{0,2}(\w+): ", section(function, "Args"), re.MULTILINE)
    assert described == list(signature.parameters)
    for parameter in signature.parameters.values():
        assert parameter.annotation is not inspect.Parameter.empty
    assert signature.return_annotation is not inspect.Signature.empty
    if signature.return_annotation not in (None, "None"):
        assert (section(function, "Returns") + section(function, "Yields")).strip()


@pytest.mark.parametrize("name", sorted(FUNCTIONS.keys() - NO_RUNNABLE_EXAMPLE))
def test_docstring_has_a_runnable_example(name):
    example = section(FUNCTIONS[name], "Example")
    assert ">>> " in example
    assert "doctest: +SKIP" not in example


@pytest.mark.parametrize("name", [n for n in FUNCTIONS if n.startswith("occjax.ops.")])
def test_options_are_keyword_only(name):
    if name.rsplit(".", 1)[1] in POSITIONAL:
        return
    for parameter in inspect.signature(FUNCTIONS[name]).parameters.values():
        optional = parameter.default is not inspect.Parameter.empty
        assert not optional or parameter.kind is inspect.Parameter.KEYWORD_ONLY


ROOT = Path(occjax.__file__).parent

BASE = {"errors", "lightfield", ""}
"""What every package may import: errors, conventions, the package itself."""

MAY_IMPORT = {
    "errors": set(),
    "xla": set(),
    "programs": {"xla"},
    "lightfield": {"errors"},
    "view_selection": BASE,
    "kernels": BASE,
    "ops": BASE | {"kernels"},
    "layout": BASE | {"kernels", "ops", "programs"},
    "io": BASE | {"layout", "programs"},
    "evaluation": BASE | {"ops", "io"},
    "viz": BASE | {"ops", "layout", "io", "evaluation", "programs"},
    "models": BASE | {"kernels", "ops", "io", "view_selection"},
    "estimators": BASE | {"ops", "layout", "models", "programs", "view_selection"},
    "data": BASE | {"kernels", "ops", "io", "view_selection"},
    "training": BASE
    | {"io", "models", "data", "evaluation", "viz", "view_selection", "estimators"},
    "report": BASE | {"io", "evaluation", "viz", "estimators", "results"},
    "results": BASE | {"ops", "io", "evaluation", "viz", "estimators"},
    "viewer": BASE
    | {"ops", "layout", "io", "evaluation", "viz", "models", "data", "estimators", "results"},
}
"""Arrows of the architecture; the command line may import everything and is imported by nothing."""

MAY_IMPORT_WHEN_CALLED = {"lightfield": {"viz"}, "estimators": {"results", "viewer", "viz"}}
"""What the methods that show, save or load an object may import within their body."""


def imported_modules(file, *, called=True):
    """Modules that a file imports at run time, with the names imported from packages.

    Imports within functions are included only if ``called``.
    """
    tree = ast.parse(file.read_text(encoding="utf-8"))
    for node in list(ast.walk(tree)):
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            node.body = []
        if isinstance(node, ast.FunctionDef) and not called:
            node.body = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file.name}: relative import"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def imported_packages(file, *, called=True):
    """Packages of this project that a file imports: ``""`` stands for ``occjax`` itself."""
    for module in imported_modules(file, called=called):
        head, *rest = module.split(".")
        if head in ("experiments", "tests"):
            yield head
        elif head == "occjax":
            known = rest and ((ROOT / rest[0]).is_dir() or (ROOT / f"{rest[0]}.py").is_file())
            yield rest[0] if known else ""


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_imports_go_one_way(package):
    files = [ROOT / f"{package}.py"]
    if (ROOT / package).is_dir():
        files = sorted((ROOT / package).rglob("*.py"))
    later = MAY_IMPORT_WHEN_CALLED.get(package, set())
    wrong = {
        f"{file.relative_to(ROOT)} imports {imported or 'occjax'}"
        for file in files
        for called, more in ((False, set()), (True, later))
        for imported in imported_packages(file, called=called)
        if imported not in MAY_IMPORT[package] | {package} | more
    }
    assert not wrong


def test_every_package_has_its_arrows():
    packages = {path.name for path in ROOT.iterdir() if (path / "__init__.py").is_file()}
    modules = {path.stem for path in ROOT.glob("*.py")} - {"__init__", "__main__"}
    assert packages | modules == MAY_IMPORT.keys() | {"cli"}


def test_the_library_imports_neither_experiments_nor_tests():
    wrong = {
        str(file.relative_to(ROOT))
        for file in ROOT.rglob("*.py")
        if {"experiments", "tests"} & set(imported_packages(file))
    }
    assert not wrong


def test_models_do_not_import_each_other():
    """A third model can be added without touching the first two."""
    models = ROOT / "models"
    folders = {path.name for path in models.iterdir() if (path / "__init__.py").is_file()}
    wrong = {
        f"{file.relative_to(ROOT)} imports {module}"
        for folder in folders
        for file in (models / folder).rglob("*.py")
        for module in imported_modules(file)
        for other in folders - {folder}
        if module.startswith(f"occjax.models.{other}.")
    }
    assert not wrong

"""The style that makes the public functions predictable, checked for each of them."""

import ast
import inspect
import re
from pathlib import Path

import pytest

from occjax import ops

FUNCTIONS = {
    name: getattr(ops, name) for name in ops.__all__ if inspect.isfunction(getattr(ops, name))
}
COMBINES = {"concatenate", "mean_and_variance"}
"""Called by the volumes with two positional arguments, as any function of the user's would be."""

functions = pytest.mark.parametrize("name", FUNCTIONS)


def section(name, title):
    """Text of one section of a docstring, empty if there is none."""
    documentation = inspect.getdoc(FUNCTIONS[name])
    found = re.search(rf"^{title}:\n((?:    .*\n?|\n)+)", documentation, re.MULTILINE)
    return found.group(1) if found else ""


def test_the_public_names_are_listed_once_and_in_order():
    assert list(ops.__all__) == sorted(set(ops.__all__))
    assert len(FUNCTIONS) >= 13


@functions
def test_the_docstring_has_a_sentence_and_a_runnable_example(name):
    first_line = inspect.getdoc(FUNCTIONS[name]).splitlines()[0]
    assert first_line.endswith(".")
    assert ">>> " in section(name, "Example")
    assert section(name, "Returns").strip()


@functions
def test_every_argument_is_described_and_annotated(name):
    described = re.findall(r"^    (\w+): ", section(name, "Args"), re.MULTILINE)
    signature = inspect.signature(FUNCTIONS[name])
    assert described == list(signature.parameters)
    assert signature.return_annotation is not inspect.Signature.empty
    for parameter in signature.parameters.values():
        assert parameter.annotation is not inspect.Parameter.empty


@pytest.mark.parametrize("name", [name for name in FUNCTIONS if name not in COMBINES])
def test_options_are_keyword_only(name):
    for parameter in inspect.signature(FUNCTIONS[name]).parameters.values():
        optional = parameter.default is not inspect.Parameter.empty
        assert not optional or parameter.kind is inspect.Parameter.KEYWORD_ONLY


def test_operations_know_nothing_of_the_rest_of_the_library():
    """Arrows go one way: only errors and the conventions are shared."""
    allowed = ("occjax.ops", "occjax.errors", "occjax.lightfield")
    for file in Path(ops.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                modules = [node.module or ""]
            elif isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            else:
                continue
            own = [module for module in modules if module.startswith("occjax")]
            assert all(module.startswith(allowed) for module in own), f"{file.name}: {own}"

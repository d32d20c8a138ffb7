"""What makes the public functions predictable, checked for each of them.

Their style, and that they take what users have at hand or say in one line why not.
"""

import ast
import graphlib
import inspect
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from occjax import ops
from occjax.errors import InputError

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
    imports: dict[str, list[str]] = {}
    for file in Path(ops.__file__).parent.glob("*.py"):
        imports[f"occjax.ops.{file.stem}"] = []
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                assert node.level == 0, f"{file.name}: relative import"
                modules = [node.module or ""]
            elif isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            else:
                continue
            own = [module for module in modules if module.startswith("occjax")]
            assert all(module.startswith(allowed) for module in own), f"{file.name}: {own}"
            imports[f"occjax.ops.{file.stem}"] += own
    graphlib.TopologicalSorter(imports).prepare()  # raises CycleError


VIEWS = np.random.default_rng(0).uniform(size=(1, 3, 4, 5, 2)).astype(np.float32)
VOLUME = np.random.default_rng(1).uniform(size=(3, 4, 5)).astype(np.float32)
DISPARITY = np.full((4, 5), 0.5, np.float32)
OFFSET = np.array([0.0, -1.0], np.float32)
CANDIDATES = np.array([-1.0, 0.0, 0.5], np.float32)
WEIGHTS = np.full(VIEWS.shape[:4], 0.5, np.float32)


OF_IMAGES = {
    "shift": lambda image: ops.shift(image[0, 0], jnp.float32(0.5), jnp.asarray(OFFSET)),
    "warp": lambda image: ops.warp(image[0, 0], jnp.asarray(DISPARITY), jnp.asarray(OFFSET)),
    "warp_views": lambda views: ops.warp_views(views, jnp.asarray(DISPARITY)),
    "coarse_volume": lambda views: ops.coarse_volume(views, jnp.asarray(CANDIDATES)),
    "refined_volume": lambda views: ops.refined_volume(
        views, jnp.asarray(DISPARITY), jnp.asarray(CANDIDATES)
    ),
    "occlusion_maps": lambda views: ops.occlusion_maps(views, jnp.asarray(DISPARITY)),
    "grey_costs": lambda views: ops.grey_costs(
        views[..., 0], jnp.asarray(CANDIDATES), grey_truncation=0.1, derivative_truncation=0.1
    ),
    "refinement_features": lambda views: ops.refinement_features(
        views[..., 0], jnp.asarray(DISPARITY)
    ),
    "concatenate": ops.concatenate,
    "mean_and_variance": ops.mean_and_variance,
    "group_correlation": ops.group_correlation(2),
}


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("name", OF_IMAGES)
@pytest.mark.parametrize("dtype", ["uint8", "int32"])
def test_integer_images_are_an_error_that_names_the_cure(name, dtype):
    """Light fields are stored as uint8: it is what one tries first."""
    with pytest.raises(InputError, match=rf"floating point, not {dtype}; pass light_field.float"):
        OF_IMAGES[name](jnp.asarray(255 * VIEWS).astype(dtype))


TRACED_WITH_CONSTANTS = {
    "shift": (lambda d: ops.shift(VIEWS[0, 0], d, OFFSET), np.float32(0.5)),
    "warp": (lambda d: ops.warp(VIEWS[0, 0], d, OFFSET), DISPARITY),
    "coarse_volume": (lambda c: ops.coarse_volume(VIEWS, c, weights=WEIGHTS), CANDIDATES),
    "refined_volume": (lambda d: ops.refined_volume(VIEWS, d, CANDIDATES), DISPARITY),
    "occlusion_maps": (lambda d: ops.occlusion_maps(VIEWS, d), DISPARITY),
    "refinement_features": (lambda d: ops.refinement_features(VIEWS[..., 0], d), DISPARITY),
    "soft_argmin": (lambda c: ops.soft_argmin(VOLUME, c), CANDIDATES),
}


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("name", TRACED_WITH_CONSTANTS)
def test_numpy_arrays_are_as_jax_arrays_also_inside_compiled_functions(name, tolerance):
    function, traced = TRACED_WITH_CONSTANTS[name]
    np.testing.assert_allclose(jax.jit(function)(traced), function(traced), **tolerance("float32"))


NUMBERS_AND_LISTS = {
    "shift": lambda take: ops.shift(VIEWS[0, 0], take(0.5), take([0.0, -1.0])),
    "coarse_volume": lambda take: ops.coarse_volume(VIEWS, take([-1.0, 0.0, 0.5])),
    "refined_volume": lambda take: ops.refined_volume(VIEWS, DISPARITY, take([-1.0, 0.0])),
    "soft_argmin": lambda take: ops.soft_argmin(VOLUME, take([-1.0, 0.0, 0.5])),
    "confidence": lambda take: ops.confidence(VOLUME / VOLUME.sum(0), take([-1.0, 0.0, 0.5])),
}


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("name", NUMBERS_AND_LISTS)
def test_numbers_and_lists_are_as_arrays(name):
    function = NUMBERS_AND_LISTS[name]
    plain, arrays = function(lambda value: value), function(lambda value: jnp.float32(value))
    np.testing.assert_array_equal(plain, arrays)


MISFITS = {
    r"features must be \[v, u, h, w, c\], not \[1, 3, 4, 5\]; grey ones as features\[..., None\]": (
        lambda: ops.coarse_volume(VIEWS[..., 0], CANDIDATES)
    ),
    r"features must be \[v, u, h, w, c\], not \[1, 1, 3": (
        lambda: ops.refined_volume(VIEWS[None], DISPARITY, CANDIDATES)
    ),
    r"candidates must be a list \[d\], not \[\]": lambda: ops.coarse_volume(VIEWS, 0.5),
    r"candidates must be \[3\] or \[3, 4, 5\] as the costs, not \[1\]": (
        lambda: ops.soft_argmin(VOLUME, CANDIDATES[:1])
    ),
    r"as the probabilities, not \[3, 1, 1\]": (
        lambda: ops.expected_disparity(VOLUME, CANDIDATES[:, None, None])
    ),
    r"probabilities must be \[d, h, w\], not \[3, 4, 5, 1\]": (
        lambda: ops.confidence(VOLUME[..., None], CANDIDATES)
    ),
    r"weights must be \[1, 3, 4, 5\], not \[1, 3, 1, 1\]": (
        lambda: ops.coarse_volume(VIEWS, CANDIDATES, weights=WEIGHTS[:, :, :1, :1])
    ),
    r"weights must be \[1, 3, 2, 5\], not \[1, 3, 4, 5\]": (
        lambda: ops.refined_volume(VIEWS, DISPARITY[:2], CANDIDATES, weights=WEIGHTS)
    ),
    r"weights must be \[1, 3, 4, 5\], not \[3, 4, 5\]": (
        lambda: ops.mean_and_variance(VIEWS, WEIGHTS[0])
    ),
    r"offsets must be \[1, 3, 2\], not \[3, 2\]": (
        lambda: ops.warp_views(VIEWS, DISPARITY, offsets=np.zeros((3, 2)))
    ),
    r"disparity must be one number, not \[2\]": (
        lambda: ops.shift(VIEWS[0, 0], CANDIDATES[:2], OFFSET)
    ),
    r"disparity must be \[4, 5\] as the image, or some rows of it, not \[4, 4\]": (
        lambda: ops.refined_volume(VIEWS, DISPARITY[:, :4], CANDIDATES)
    ),
    r"disparity must be \[4, 5\] as the image, or some rows of it, not \[8, 5\]": (
        lambda: ops.warp_views(VIEWS, np.tile(DISPARITY, (2, 1)))
    ),
    r"disparity must be \[4, 5\] as the views, not \[1, 5\]": (
        lambda: ops.occlusion_maps(VIEWS, DISPARITY[:1])
    ),
}


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("message", MISFITS)
def test_shapes_that_do_not_fit_are_an_error_not_a_broadcast(message):
    with pytest.raises(InputError, match=message):
        MISFITS[message]()

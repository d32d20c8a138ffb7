"""Read weights in the format of the published Keras 2 code (HDF5)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import traverse_util

from occjax.errors import InputError
from occjax.io.files import decoding
from occjax.io.hdf5 import check_heaps, read_dataset
from occjax.models.occcasnet.config import OccCasNetConfig
from occjax.models.occcasnet.network import variable_shapes

_NAME = re.compile(
    r"(?:.*/)?(?P<layer>conv2d|conv3d|batch_normalization)(?:_(?P<number>\d+))?"
    r"/(?P<weight>kernel|bias|gamma|beta|moving_mean|moving_variance):0"
)
_NORM = {
    "gamma": ("params", "scale"),
    "beta": ("params", "bias"),
    "moving_mean": ("batch_stats", "mean"),
    "moving_variance": ("batch_stats", "var"),
}


class _Layer(NamedTuple):
    """A layer of the network: its kind in Keras and the path of its variables."""

    kind: str
    path: tuple[str, ...]
    weights: tuple[str, ...]


def load_published_weights(path: str | Path, config: OccCasNetConfig) -> dict:
    """Read a published OccCasNet checkpoint into the variables of :class:`OccCasNet`.

    Layers are matched by kind and order of creation. The numbers in their names (``conv3d_13``)
    give that order; they may start anywhere.

    Args:
        path: HDF5 file of Keras 2, from ``model.save`` or ``model.save_weights``.
        config: The network that the weights were trained for. Weights of the published code need
            ``warp="transposed"``.

    Returns:
        ``variables`` with collections ``params`` and ``batch_stats``, float32.

    Raises:
        InputError: If the file cannot be read or a weight does not fit; the message names it.
    """
    remaining = group_by_layer(Path(path), read_arrays(Path(path)))
    template = traverse_util.flatten_dict(variable_shapes(config))
    flat = {}
    for layer in _layers_in_creation_order(config):
        if not remaining[layer.kind]:
            raise InputError(f"{path}: has no {layer.kind} weight for {'/'.join(layer.path)}")
        name, weights = remaining[layer.kind].pop(0)
        for weight in layer.weights:
            collection, leaf = _NORM.get(weight, ("params", weight))
            target = (collection, *layer.path, leaf)
            if weight not in weights:
                raise InputError(f"{path}: {name} has no {weight} for {'/'.join(target)}")
            flat[target] = _fit(f"{path}: {name}/{weight}", weights.pop(weight), template[target])
        if weights:
            raise InputError(f"{path}: the network has no weight like {name}/{next(iter(weights))}")
    for layers in remaining.values():
        if layers:
            name, weights = layers[0]
            raise InputError(f"{path}: the network has no weight like {name}/{next(iter(weights))}")
    return traverse_util.unflatten_dict(flat)


def read_arrays(path: Path) -> Iterator[tuple[str, np.ndarray]]:
    """Yield names and values of all weights in a Keras 2 file."""
    try:
        import h5py
    except ImportError as error:
        raise InputError(
            f"{path}: reading HDF5 weights needs h5py: pip install 'occjax[published]'"
        ) from error
    with decoding(path, "an HDF5 file of weights") as opened, h5py.File(path, "r") as file:
        check_heaps(opened)
        stored = {"": file}  # without links, which may lead to other files
        file.visititems(stored.__setitem__)
        root = "model_weights/" if "model_weights" in stored else ""
        if "layer_names" not in stored[root.rstrip("/")].attrs:
            raise InputError(f"{path}: is not a Keras 2 weights file (no 'layer_names' attribute)")
        for layer in _text(stored[root.rstrip("/")].attrs["layer_names"]):
            group = stored.get(root + layer)
            if group is None or "weight_names" not in group.attrs:
                raise InputError(f"{path}: lists {layer} but does not contain it; copy it again")
            for name in _text(group.attrs["weight_names"]):
                dataset = stored.get(f"{root}{layer}/{name}")
                if dataset is None:
                    raise InputError(f"{path}: lists {name} but does not contain it; copy it again")
                yield name, read_dataset(path, dataset)


def _text(names: Iterable[bytes | str]) -> list[str]:
    """Decode names: Keras writes bytes, other tools may write str."""
    return [name.decode() if isinstance(name, bytes) else str(name) for name in names]


def group_by_layer(
    path: Path, weights: Iterator[tuple[str, np.ndarray]]
) -> dict[str, list[tuple[str, dict[str, np.ndarray]]]]:
    """Group the weights by kind of layer and layer, layers in the order of creation."""
    numbered: dict[str, dict[int, tuple[str, dict[str, np.ndarray]]]] = {
        kind: {} for kind in ("conv2d", "conv3d", "batch_normalization")
    }
    for name, value in weights:
        match = _NAME.fullmatch(name)
        if match is None:
            raise InputError(f"{path}: the network has no weight like {name}")
        layers, number = numbered[match["layer"]], int(match["number"] or 0)
        _, arrays = layers.setdefault(number, (name.rpartition("/")[0], {}))
        arrays[match["weight"]] = value
    return {kind: [layers[n] for n in sorted(layers)] for kind, layers in numbered.items()}


def _layers_in_creation_order(config: OccCasNetConfig) -> Iterator[_Layer]:
    """Yield the layers of the network in the order in which the published code creates them."""

    def convolution(kind, *path):
        return _Layer(kind, path, ("kernel",))

    def norm(*path):
        return _Layer("batch_normalization", path, tuple(_NORM))

    features = config.features
    for index in range(2):
        yield convolution("conv2d", "features", f"stem_{index}")
        yield norm("features", f"stem_{index}_norm")
    for group, blocks in enumerate(features.blocks):
        for block in range(blocks):
            path = ("features", f"group_{group}_block_{block}")
            if group > 0 and block == 0:
                yield convolution("conv2d", *path, "shortcut")
                yield norm(*path, "shortcut_norm")
            for index in range(2):
                yield convolution("conv2d", *path, f"conv_{index}")
                yield norm(*path, f"norm_{index}")
    for name in (*(f"pooled_{size}" for size in features.pooled), "fused"):
        yield convolution("conv2d", "features", name)
        yield norm("features", f"{name}_norm")
    yield convolution("conv2d", "features", "output")

    for index, stage in enumerate(
        config.stages[:1] if config.shared_aggregation else config.stages
    ):
        if stage.attention:
            for name in ("hidden", "octant"):
                yield _Layer("conv3d", (f"attention_{index}", name), ("kernel", "bias"))
        pairs = [
            f"pair_{pair}_conv_{half}" for pair in range(stage.aggregation.pairs) for half in (0, 1)
        ]
        for name in ("conv_0", "conv_1", *pairs, "conv_2"):
            yield convolution("conv3d", f"aggregation_{index}", name)
            yield norm(f"aggregation_{index}", f"{name}_norm")
        yield convolution("conv3d", f"aggregation_{index}", "score")


def _fit(name: str, value: np.ndarray, target: jax.ShapeDtypeStruct) -> jax.Array:
    """Reshape a weight to its target; Keras stores dense layers as 1x1x1 convolutions."""
    squeezed = value
    if value.ndim == 5 and len(target.shape) == 2 and value.shape[:3] == (1, 1, 1):
        squeezed = value[0, 0, 0]
    if squeezed.shape != target.shape:
        raise InputError(
            f"{name}: has shape {list(value.shape)}, the network needs {list(target.shape)}"
        )
    if value.dtype.kind != "f" or not np.isfinite(value).all():
        raise InputError(f"{name}: has values that are not finite")
    return jnp.asarray(squeezed, jnp.float32)

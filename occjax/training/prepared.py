"""Light fields of pools, prepared: what a light network chooses from, computed once.

Everything before the choice of a network of any arrangement of views depends on no weights and
takes most of the time of a step. It is computed when a light field is first drawn and kept in a
folder, in about sixteen bytes for each pixel and proposal; all later steps train the choice alone.
"""

from __future__ import annotations

import dataclasses
import json
import zipfile
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float16, Int16, UInt8

import occjax
from occjax.data.augmentation import AugmentationConfig, random_noise, random_tone
from occjax.data.host import to_device
from occjax.data.pool import DESCRIPTION, light_field_file, pool_size, read_sample
from occjax.data.samples import Sample
from occjax.data.sources import check_batch_size
from occjax.data.views import select_views
from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.io.claims import claim_folder, read_description
from occjax.io.files import reading
from occjax.models import Choice, NetworkConfig, OccCasNet
from occjax.models.config import of_kind
from occjax.models.description import config_to_json
from occjax.models.proposals import Proposals
from occjax.ops.aperture import SECTORS

PREPARATION = "preparation.json"

FINENESS = 4096.0
"""Proposals are kept as multiples of one over this, up to +-8 pixels per view step."""

PLACES = 4
"""Of so many places for a patch, the one with the most to mend is taken."""

MENDABLE = 0.05
"""Error from which on a pixel is to be mended, up to which a proposal mends it."""


Places = tuple[tuple[int, int], ...]


class Packed(NamedTuple):
    """Proposals in few bytes; :func:`unpack` tells what the numbers mean."""

    centre: UInt8[Array, "*b h w"]
    disparity: Float[Array, "*b h w"]
    proposed: Int16[Array, "*b k h w"]
    costs: UInt8[Array, "*b k 13 h w"]
    spread: Float16[Array, "*b 2 h w"]


class PreparedSample(NamedTuple):
    """A training example for the choice alone, or a batch with a leading axis on every field.

    Attributes:
        packed: What there is to choose from.
        disparity: ``[h, w]`` true disparity, scaled as the proposals are.
        valid: ``[h, w]`` pixels whose ground truth counts.
    """

    packed: Packed
    disparity: Float[Array, "*b h w"]
    valid: Bool[Array, "*b h w"]


def pack(proposals: Proposals) -> Packed:
    """Proposals in few bytes."""
    largest = np.iinfo(np.int16).max
    return Packed(
        jnp.rint(255.0 * jnp.clip(proposals.centre, 0.0, 1.0)).astype(jnp.uint8),
        proposals.disparity,
        jnp.clip(jnp.rint(FINENESS * proposals.proposed), -largest, largest).astype(jnp.int16),
        # The smallest costs tell most.
        jnp.rint(255.0 * jnp.sqrt(proposals.costs.astype(jnp.float32))).astype(jnp.uint8),
        proposals.spread.astype(jnp.float16),
    )


def unpack(packed: Packed) -> Proposals:
    """The proposals, to within rounding."""
    return Proposals(
        packed.centre.astype(jnp.float32) / 255.0,
        packed.disparity,
        packed.proposed.astype(jnp.float32) / FINENESS,
        jnp.square(packed.costs.astype(jnp.float32) / 255.0).astype(jnp.float16),
        packed.spread.astype(jnp.float32),
    )


def prepared_source(
    pools: Sequence[str | Path],
    folder: str | Path,
    network: NetworkConfig,
    batch_size: int,
    seed: int,
    *,
    augmentation: AugmentationConfig,
) -> Callable[[int], PreparedSample]:
    """Light fields of pools, each once in a random order, then all in another order.

    Tone and noise of a light field are drawn once, before it is prepared; patch and symmetry each
    time. Of a few places for a patch the one with the most pixels that a choice can mend is taken.

    Args:
        pools: Folders of :func:`occjax.data.pool.render_pool`, of light fields of one size; of a
            grid of views the ``"outer_star"`` is used.
        folder: Where what is prepared is kept; made if it is not there.
        network: For which it is prepared.
        batch_size: Light fields per step.
        seed: Of order, patches and symmetries; in a new folder also of tone and noise, which stay
            those of the seed it was made with.
        augmentation: How light fields are varied; without stride and shear.

    Returns:
        Source of batches of :class:`PreparedSample`.

    Raises:
        InputError: If the folder holds something else, or a pool is none or empty.
    """
    check_batch_size(batch_size)
    folder = Path(folder)
    files = [file for pool in pools for file in _light_fields(Path(pool))]
    if augmentation.shear or augmentation.largest_stride > 1:
        raise InputError(
            "light fields are prepared whole: leave out augmentation.shear and .strides"
        )
    if any(side % network.multiple for side in augmentation.crop or ()):
        raise InputError(
            f"augmentation.crop is {augmentation.crop}; the network takes multiples of "
            f"{network.multiple} pixels"
        )
    description = _description(pools, network, seed, augmentation)
    varied = claim_folder(
        folder, PREPARATION, description, contents="prepared light fields", may_differ=("seed",)
    )["seed"]
    places = network.stages[1].neighbours

    @lru_cache(maxsize=2)
    def order(epoch: int) -> np.ndarray:
        return np.random.default_rng((seed, epoch)).permutation(len(files))

    def one(number: int) -> PreparedSample:
        path = folder / f"{number:06d}.npz"
        if not path.exists():
            sample = select_views(read_sample(files[number]), "outer_star")
            key = jax.random.fold_in(jax.random.key(varied), number)
            write_prepared(path, prepare(key, to_device(sample), network, augmentation))
        return read_prepared(path)

    def source(step: int) -> PreparedSample:
        patches = []
        for drawn in range(step * batch_size, (step + 1) * batch_size):
            epoch, index = divmod(drawn, len(files))
            generator = np.random.default_rng((seed, drawn))
            patches.append(patch(generator, one(int(order(epoch)[index])), places, augmentation))
        return jax.tree.map(lambda *fields: jnp.asarray(np.stack(fields)), *patches)

    return source


@partial(jax.jit, static_argnames=("network", "augmentation"))
def prepare(
    key: Array, sample: Sample, network: NetworkConfig, augmentation: AugmentationConfig
) -> PreparedSample:
    """Vary tone and noise of one light field, and compute what a network chooses from.

    Args:
        key: Random key.
        sample: One light field.
        network: Of any arrangement of views.
        augmentation: Whose tone and noise are drawn.

    Returns:
        The prepared light field, as large as the sample.
    """
    for_tone, for_noise = jax.random.split(key)
    sample = random_tone(
        for_tone,
        sample,
        gamma=augmentation.gamma,
        contrast=augmentation.contrast,
        brightness=augmentation.brightness,
    )
    sample = random_noise(
        for_noise,
        sample,
        largest=augmentation.noise,
        probability=augmentation.noise_probability,
    )
    proposals = of_kind(
        OccCasNet(network).apply({}, sample.views, sample.offsets, method="propose"), Proposals
    )
    scale = jnp.max(jnp.abs(sample.offsets)) / network.reach
    return PreparedSample(pack(proposals), sample.disparity * scale, sample.valid)


def patch(
    generator: np.random.Generator,
    sample: PreparedSample,
    places: Places,
    augmentation: AugmentationConfig,
) -> PreparedSample:
    """Cut a patch out of a prepared light field, flip and transpose it at random.

    Args:
        generator: What is drawn from.
        sample: Of NumPy arrays, without a batch axis.
        places: Of the neighbours that propose.
        augmentation: Its crop, flips and turns count.

    Returns:
        The patch.
    """
    size = augmentation.crop or sample.disparity.shape
    room = [length - used for length, used in zip(sample.disparity.shape, size, strict=True)]
    if min(room) < 0:
        raise InputError(
            f"light fields of {list(sample.disparity.shape)} pixels are smaller than the crop, "
            f"{list(size)}; render larger ones or pass a smaller data.augmentation.crop"
        )
    mendable = _mendable(sample)
    corners = generator.integers(0, np.array(room) + 1, (PLACES, 2))
    frames = [np.s_[..., y : y + size[0], x : x + size[1]] for y, x in corners]
    frame = max(frames, key=lambda frame: mendable[frame].sum())
    sample = jax.tree.map(lambda field: field[frame], sample)
    exchanged, upside_down, mirrored = generator.integers(0, 2, 3)
    if augmentation.turns and exchanged:
        sample = transpose(sample, places)
    if augmentation.flips and upside_down:
        sample = flip_rows(sample, places)
    if augmentation.flips and mirrored:
        sample = flip_columns(sample, places)
    return sample


def transpose(sample: PreparedSample, places: Places) -> PreparedSample:
    """Exchange rows and columns, of pixels and of views."""
    turned = jax.tree.map(lambda field: np.swapaxes(field, -1, -2), sample)
    return _moved(turned, places, lambda sector: 2 - sector, lambda row, column: (column, row))


def flip_rows(sample: PreparedSample, places: Places) -> PreparedSample:
    """Turn upside down, pixels and views."""
    turned = jax.tree.map(lambda field: field[..., ::-1, :], sample)
    return _moved(turned, places, lambda sector: -sector, lambda row, column: (-row, column))


def flip_columns(sample: PreparedSample, places: Places) -> PreparedSample:
    """Mirror left to right, pixels and views."""
    turned = jax.tree.map(lambda field: field[..., ::-1], sample)
    return _moved(
        turned, places, lambda sector: SECTORS // 2 - sector, lambda row, column: (row, -column)
    )


def write_prepared(path: Path, sample: PreparedSample) -> None:
    """Write one prepared light field.

    Args:
        path: The ``.npz`` file.
        sample: Without a batch axis.

    Raises:
        InputError: If it cannot be written.
    """
    fields = {**sample.packed._asdict(), "truth": sample.disparity, "valid": sample.valid}
    arrays: dict[str, Any] = {name: np.asarray(field) for name, field in fields.items()}
    with atomic_path(path) as temporary:
        np.savez(temporary, **arrays)


def read_prepared(path: Path) -> PreparedSample:
    """Read what :func:`write_prepared` writes, as NumPy arrays.

    Args:
        path: The ``.npz`` file.

    Returns:
        The prepared light field.

    Raises:
        InputError: If it cannot be read.
    """
    try:
        with reading(path), path.open("rb") as file, np.load(file) as stored:
            packed = Packed(*(stored[name] for name in Packed._fields))
            return PreparedSample(packed, stored["truth"], stored["valid"])
    except (zipfile.BadZipFile, KeyError, ValueError, EOFError) as error:
        raise InputError(f"{path}: is damaged; remove it, it is made again") from error


def _light_fields(pool: Path) -> list[Path]:
    """The files of a pool."""
    count = pool_size(pool)
    if not count:
        raise InputError(f"{pool}: is an empty pool; render it first")
    return [light_field_file(pool, number) for number in range(count)]


def _mendable(sample: PreparedSample) -> np.ndarray:
    """Where the disparity is wrong and some proposal is right."""
    truth = np.asarray(sample.disparity)
    proposed = np.asarray(sample.packed.proposed) / np.float32(FINENESS)
    nearest = np.abs(proposed - truth).min(0)
    wrong = np.abs(np.asarray(sample.packed.disparity) - truth) > MENDABLE
    return wrong & (nearest < MENDABLE) & np.asarray(sample.valid)


def _moved(sample: PreparedSample, places: Places, sector_of, place_of) -> PreparedSample:
    """Costs of sectors and proposals of neighbours where, turned, they belong.

    Args:
        sample: Its images are turned already.
        places: Of the neighbours.
        sector_of: The sector that a sector becomes.
        place_of: The place that a place becomes; doing it twice does nothing.
    """
    packed = sample.packed
    order = np.arange(packed.costs.shape[-3])
    order[sector_of(np.arange(SECTORS)) % SECTORS] = np.arange(SECTORS)
    proposers = np.arange(packed.proposed.shape[-3])
    proposers[1 : 1 + len(places)] = [1 + places.index(place_of(*place)) for place in places]
    turned = packed._replace(
        proposed=packed.proposed[proposers], costs=packed.costs[proposers][:, order]
    )
    return sample._replace(packed=turned)


def _description(
    pools: Sequence[str | Path], network: NetworkConfig, seed: int, augmentation: AugmentationConfig
) -> dict:
    """All that a prepared light field depends on."""
    kept = ("gamma", "contrast", "brightness", "noise", "noise_probability")
    return {
        "version": occjax.__version__,
        "pools": [read_description(Path(pool) / DESCRIPTION) for pool in pools],
        "network": json.loads(config_to_json(_without_weights(network))),
        "seed": seed,
        "augmentation": {name: getattr(augmentation, name) for name in kept},
    }


def _without_weights(network: NetworkConfig) -> NetworkConfig:
    """The same for all widths of the learned part."""
    search, choice = network.stages
    plain = dataclasses.replace(choice, aggregation=Choice(), window=None)
    return dataclasses.replace(network, stages=(search, plain))

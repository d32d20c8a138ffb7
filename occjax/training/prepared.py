"""Prepared light fields: the inputs of ProposalNet's learned parts, computed once for many steps.

The steps before a learned part do not change while it is trained, and take most of the time of a
training step. The inputs are computed when a light field is first drawn and kept in a folder: the
proposals for the selector, in about 16 bytes per pixel and proposal, or the volume around the
selected disparity for the residual, in 95 bytes per pixel.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, get_args

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float16, Float32, Int16, UInt8

import occjax
from occjax.data.augmentation import random_noise, random_tone
from occjax.data.config import AugmentationConfig
from occjax.data.pool import DESCRIPTION, light_field_files, read_sample, shuffled
from occjax.data.samples import LightFieldSample, select_views, to_device
from occjax.data.scenes import Scene
from occjax.data.sources import ALL_ROWS, check_batch_size, sample_counts, sample_numbers
from occjax.data.transforms import Symmetry, transform_images, transform_offsets
from occjax.errors import InputError
from occjax.io.arrays import load_fields
from occjax.io.atomic import atomic_path
from occjax.io.run_folder import open_run_folder, read_description
from occjax.models import ProposalNet, ProposalNetConfig
from occjax.models.config_json import config_to_json
from occjax.models.proposal.aperture import SECTORS
from occjax.models.proposal.proposals import COST_CHANNELS, ProposalCosts, Proposals
from occjax.models.proposal.residual import STATISTICS, ResidualVolume
from occjax.training.config import PatchConfig

PREPARATION = "preparation.json"
"""File that describes the light fields of a folder of prepared light fields."""

DISPARITY_STEPS = 4096.0
"""Number of steps per pixel in which proposed disparities are stored, up to 8 pixels per view step
in either direction."""


class PackedProposals(NamedTuple):
    """Proposals in few bytes, or a batch with a leading axis on every field.

    Attributes:
        centre: ``[h, w]`` grey centre view, times 255.
        disparity: ``[h, w]`` refined disparity.
        proposed: ``[k, h, w]`` proposed disparities, times 4096.
        costs: ``[k, COST_CHANNELS, h, w]`` square roots of the costs, times 255.
        log_variance: ``[h, w]`` scaled logarithm of the variance of the search's candidates.
        peak_probability: ``[h, w]`` probability of the search's most likely candidate.
    """

    centre: UInt8[Array, "*b h w"]
    disparity: Float[Array, "*b h w"]
    proposed: Int16[Array, "*b k h w"]
    costs: UInt8[Array, f"*b k {COST_CHANNELS} h w"]
    log_variance: Float16[Array, "*b h w"]
    peak_probability: Float16[Array, "*b h w"]


class PreparedSample(NamedTuple):
    """A training example for a learned part, or a batch with a leading axis on every field.

    Attributes:
        packed: Proposals for the selector; volume, in half precision, for the residual.
        disparity: ``[h, w]`` true disparity, scaled to the configured reach like the inputs.
        valid: ``[h, w]`` pixels with ground truth.
    """

    packed: PackedProposals | ResidualVolume
    disparity: Float[Array, "*b h w"]
    valid: Bool[Array, "*b h w"]


TRUTH_FIELDS = {"truth": Float32[np.ndarray, "h w"], "valid": Bool[np.ndarray, "h w"]}

PROPOSAL_FIELDS = {
    "centre": UInt8[np.ndarray, "h w"],
    "disparity": Float32[np.ndarray, "h w"],
    "proposed": Int16[np.ndarray, "k h w"],
    "costs": UInt8[np.ndarray, f"k {COST_CHANNELS} h w"],
    "log_variance": Float16[np.ndarray, "h w"],
    "peak_probability": Float16[np.ndarray, "h w"],
}

VOLUME_FIELDS = {
    "centre": Float16[np.ndarray, "h w"],
    "disparity": Float32[np.ndarray, "h w"],
    "reference": Float16[np.ndarray, f"{STATISTICS} h w"],
    "relative": Float16[np.ndarray, f"{STATISTICS} d h w"],
    "certainty": Float16[np.ndarray, "h w"],
    "log_information": Float16[np.ndarray, "h w"],
}


def pack(proposals: Proposals) -> PackedProposals:
    """Store the proposals of one light field in few bytes."""
    largest = np.iinfo(np.int16).max
    # Square roots keep small costs, which matter most, accurate.
    costs = jnp.sqrt(proposals.costs.channels.astype(jnp.float32))
    proposed = jnp.clip(jnp.rint(DISPARITY_STEPS * proposals.proposed), -largest, largest)
    return PackedProposals(
        centre=jnp.rint(255.0 * jnp.clip(proposals.centre, 0.0, 1.0)).astype(jnp.uint8),
        disparity=proposals.disparity,
        proposed=proposed.astype(jnp.int16),
        costs=jnp.rint(255.0 * costs).astype(jnp.uint8),
        log_variance=proposals.log_variance.astype(jnp.float16),
        peak_probability=proposals.peak_probability.astype(jnp.float16),
    )


def pack_volume(volume: ResidualVolume) -> ResidualVolume:
    """Store all maps but the disparity of a volume in half precision."""
    half = jax.tree.map(lambda maps: maps.astype(jnp.float16), volume)
    return half._replace(disparity=volume.disparity)


def unpack(packed: PackedProposals) -> Proposals:
    """Return the proposals that :func:`pack` stored, exact up to rounding."""
    costs = jnp.square(packed.costs.astype(jnp.float32) / 255.0)
    return Proposals(
        centre=packed.centre.astype(jnp.float32) / 255.0,
        disparity=packed.disparity,
        proposed=packed.proposed.astype(jnp.float32) / DISPARITY_STEPS,
        costs=ProposalCosts(costs.astype(jnp.float16)),
        log_variance=packed.log_variance.astype(jnp.float32),
        peak_probability=packed.peak_probability.astype(jnp.float32),
    )


def prepared_source(
    pools: Sequence[str | Path],
    folder: str | Path,
    network: ProposalNetConfig,
    batch_size: int,
    seed: int,
    *,
    augmentation: AugmentationConfig,
    patches: PatchConfig | None = None,
    scenes: Sequence[Scene] = (),
    weights: tuple[float, float] = (1.0, 1.0),
    variables: dict | None = None,
) -> Callable[..., PreparedSample]:
    """Return a source that goes through light fields in random order, in a new order each time.

    Tone, noise and grey weights of a light field are drawn once, before its proposals are computed;
    patches and symmetries are drawn each time.

    Args:
        pools: Folders of :func:`occjax.data.pool.render_pool`, whose light fields have one size.
        folder: Folder of the prepared light fields; created if it does not exist.
        network: Network that computes the inputs.
        batch_size: Light fields per step.
        seed: Seed of order, patches and symmetries. A new folder stores it as its seed of grey
            weights, tone and noise; these do not change if the folder is used with another seed.
        augmentation: How light fields are varied.
        patches: Choice of the patches.
        scenes: Scenes from :func:`occjax.data.scenes.load_scenes`, with the views of the network.
        weights: Relative shares of pools and scenes in every batch.
        variables: Variables of the network. If given, the volume for the residual is computed with
            them; if None, the proposals for the selector, which need no variables.

    Returns:
        Source of batches of :class:`PreparedSample`, or of their rows, see
        :class:`occjax.data.sources.Source`.

    Raises:
        InputError: If the folder contains something else, if a pool is missing or empty, if there
            are no light fields, or if the crop does not fit the network; when called, if the crop
            is larger than the light fields.
    """
    check_batch_size(batch_size)
    folder = Path(folder)
    files = [file for pool in pools for file in light_field_files(pool)]
    if augmentation.crop is not None:
        check_crop(augmentation.crop, network)
    parts = {"": len(files), "scene_": len(scenes)}  # beginnings of the names of stored files
    present = [w if count else 0.0 for w, count in zip(weights, parts.values(), strict=True)]
    if not sum(present) > 0.0:
        raise InputError("there are no light fields to prepare; pass pools or scenes")
    description = _description(pools, scenes, network, seed, augmentation, variables)
    stored = open_run_folder(
        folder, PREPARATION, description, contents="prepared light fields", may_differ=("seed",)
    )

    whole = dataclasses.replace(augmentation, crop=None)  # other crops share a compiled program

    orders = [shuffled(count, seed) for count in parts.values()]

    def stored_sample(part: str, number: int) -> PreparedSample:
        path = folder / f"{part}{number:06d}.npz"
        if not path.exists():
            if part:
                generator = np.random.default_rng((stored["seed"], number))
                sample = scenes[number].sample(weights=0.05 + generator.uniform(size=3))
            else:
                sample = select_views(read_sample(files[number]), network.views)
            key = jax.random.fold_in(jax.random.key(stored["seed"]), number)
            prepared = prepare(key, to_device(sample), network, whole, variables)
            write_prepared(path, prepared)
        return read_prepared(path, volume=variables is not None)

    def light_field(drawn: int) -> PreparedSample:
        before, after = (sample_counts(present, total) for total in (drawn, drawn + 1))
        # The source whose number of samples grows by this draw.
        index = int(np.argmax(np.subtract(after, before)))
        return stored_sample(list(parts)[index], orders[index](before[index]))

    patch_options = network.proposals.offsets, augmentation, patches or PatchConfig()

    def source(step: int, rows: slice = ALL_ROWS, /) -> PreparedSample:
        samples = []
        for drawn in sample_numbers(step, rows, batch_size):
            generator = np.random.default_rng((seed, drawn))
            samples.append(random_patch(generator, light_field(drawn), *patch_options))
        return jax.tree.map(lambda *fields: jnp.asarray(np.stack(fields)), *samples)

    return source


@partial(jax.jit, static_argnames=("network", "augmentation"))
def prepare(
    key: Array,
    sample: LightFieldSample,
    network: ProposalNetConfig,
    augmentation: AugmentationConfig,
    variables: dict | None = None,
) -> PreparedSample:
    """Vary tone and noise of one light field (no batch axis) and compute the inputs.

    Args:
        key: Random key.
        sample: The light field.
        network: The network.
        augmentation: How tone and noise are varied.
        variables: The same as for :func:`prepared_source`.
    """
    tone_key, noise_key = jax.random.split(key)
    sample = random_noise(noise_key, random_tone(tone_key, sample, augmentation), augmentation)
    if variables is None:
        proposals, disparity = proposals_and_truth(sample, network)
        return PreparedSample(pack(proposals), disparity, sample.valid)
    volume, disparity = volume_and_truth(sample, network, variables)
    return PreparedSample(pack_volume(volume), disparity, sample.valid)


def proposals_and_truth(
    sample: LightFieldSample, network: ProposalNetConfig
) -> tuple[Proposals, Float[Array, "h w"]]:
    """Return proposals and true disparity of one light field, both at the configured reach."""
    proposals = ProposalNet(network).apply({}, sample.views, sample.offsets, method="propose")
    assert isinstance(proposals, Proposals)
    return proposals, _truth_at_reach(sample, network)


def volume_and_truth(
    sample: LightFieldSample, network: ProposalNetConfig, variables: dict
) -> tuple[ResidualVolume, Float[Array, "h w"]]:
    """Return the volume around the selected disparity of one light field, and the true disparity.

    Args:
        sample: The light field, without a batch axis.
        network: The network.
        variables: Its variables.

    Returns:
        Both at the configured reach.
    """
    volume = ProposalNet(network).apply(
        variables, sample.views, sample.offsets, method="compute_volume"
    )
    assert isinstance(volume, ResidualVolume)
    return volume, _truth_at_reach(sample, network)


def _truth_at_reach(sample: LightFieldSample, network: ProposalNetConfig) -> Float[Array, "h w"]:
    return sample.disparity * (jnp.max(jnp.abs(sample.offsets)) / network.reach)


def check_crop(crop: tuple[int, ...], network: ProposalNetConfig) -> None:
    """Check that the network can be applied to patches of ``(h, w)`` pixels.

    Raises:
        InputError: If the size is not a multiple of ``network.size_multiple``.
    """
    if any(side % network.size_multiple for side in crop):
        raise InputError(
            f"data.augmentation.crop is {'x'.join(map(str, crop))} pixels; the network needs "
            f"multiples of {network.size_multiple} pixels"
        )


def random_patch(
    generator: np.random.Generator,
    sample: PreparedSample,
    offsets: tuple[tuple[int, int], ...],
    augmentation: AugmentationConfig,
    config: PatchConfig,
) -> PreparedSample:
    """Cut a patch out of a prepared light field, and flip and transpose it at random.

    Args:
        generator: Random generator.
        sample: NumPy arrays, without a batch axis.
        offsets: Offsets ``(row, column)`` of the proposing neighbours, in pixels.
        augmentation: Its crop, flips and turns.
        config: Choice of the position.

    Raises:
        InputError: If the light field is smaller than the crop.
    """
    size = augmentation.crop or sample.disparity.shape
    room = [length - used for length, used in zip(sample.disparity.shape, size, strict=True)]
    if min(room) < 0:
        raise InputError(
            f"light fields of {list(sample.disparity.shape)} pixels are smaller than the crop, "
            f"{list(size)}; render larger ones or pass a smaller data.augmentation.crop"
        )
    correctable = _correctable(sample, config.correctable_error)
    corners = generator.integers(0, np.array(room) + 1, (config.draws, 2))
    windows = [np.s_[..., y : y + size[0], x : x + size[1]] for y, x in corners]
    window = max(windows, key=lambda window: correctable[window].sum())
    sample = jax.tree.map(lambda field: field[window], sample)
    for symmetry, drawn in zip(get_args(Symmetry), generator.integers(0, 2, 3), strict=True):
        if drawn and (augmentation.turns if symmetry == "transpose" else augmentation.flips):
            sample = transform_prepared(sample, symmetry, offsets)
    return sample


def transform_prepared(
    sample: PreparedSample, symmetry: Symmetry, offsets: tuple[tuple[int, int], ...]
) -> PreparedSample:
    """Flip or transpose a prepared light field: pixels and views together.

    Args:
        sample: NumPy arrays, without a batch axis.
        symmetry: The change.
        offsets: Offsets ``(row, column)`` of the proposing neighbours, in pixels.

    Returns:
        The changed light field, with the costs of sectors and the proposals of neighbours in the
        order of the changed directions.
    """
    sectors = np.arange(SECTORS)
    turned_sectors = {
        "transpose": 2 - sectors,
        "flip_rows": -sectors,
        "flip_columns": SECTORS // 2 - sectors,
    }
    sector_order = np.empty_like(sectors)
    sector_order[turned_sectors[symmetry] % SECTORS] = sectors
    sample = jax.tree.map(lambda field: transform_images(field, symmetry), sample)
    if isinstance(sample.packed, ResidualVolume):  # nothing in it has a direction
        return sample
    proposed, costs = sample.packed.proposed, ProposalCosts(sample.packed.costs)
    order = np.arange(len(proposed))
    for number, offset in enumerate(offsets, start=1):
        order[number] = 1 + offsets.index(tuple(transform_offsets(np.array(offset), symmetry)))
    turned = costs.permute_sectors(sector_order).channels[order]
    packed = sample.packed._replace(proposed=proposed[order], costs=turned)
    return sample._replace(packed=packed)


def write_prepared(path: Path, sample: PreparedSample) -> None:
    """Write one prepared light field (no batch axis) to an ``.npz`` file.

    Raises:
        InputError: If the file cannot be written.
    """
    fields = {**sample.packed._asdict(), "truth": sample.disparity, "valid": sample.valid}
    arrays: dict[str, Any] = {name: np.asarray(field) for name, field in fields.items()}
    with atomic_path(path) as temporary:
        np.savez(temporary, **arrays)


def read_prepared(path: Path, *, volume: bool = False) -> PreparedSample:
    """Read a prepared light field that :func:`write_prepared` wrote, as NumPy arrays.

    Args:
        path: The file.
        volume: Whether it contains the volume for the residual instead of proposals.

    Raises:
        InputError: If the file cannot be read or is damaged.
    """
    what, remedy = "a prepared light field", "remove it, and it is computed again"
    stored, kind = (VOLUME_FIELDS, ResidualVolume) if volume else (PROPOSAL_FIELDS, PackedProposals)
    fields = load_fields(path, {**stored, **TRUTH_FIELDS}, what=what, remedy=remedy)
    truth, valid = fields.pop("truth"), fields.pop("valid")
    # The fields are annotated as JAX arrays; Any permits NumPy arrays.
    packed: Any = kind(**fields)  # type: ignore[arg-type]
    return PreparedSample(packed, truth, valid)  # type: ignore[arg-type]


def _correctable(sample: PreparedSample, threshold: float) -> np.ndarray:
    """Return ``[h, w]`` whether the disparity is wrong and a proposal, if any, is correct."""
    truth = np.asarray(sample.disparity)
    wrong = np.abs(np.asarray(sample.packed.disparity) - truth) > threshold
    wrong &= np.asarray(sample.valid)
    if isinstance(sample.packed, ResidualVolume):
        return wrong
    proposed = np.asarray(sample.packed.proposed) / np.float32(DISPARITY_STEPS)
    return wrong & (np.abs(proposed - truth).min(0) < threshold)


def _description(
    pools: Sequence[str | Path],
    scenes: Sequence[Scene],
    network: ProposalNetConfig,
    seed: int,
    augmentation: AugmentationConfig,
    variables: dict | None,
) -> dict:
    """Return all settings that the prepared light fields depend on."""
    network = dataclasses.replace(network, planar=None)
    if variables is None:
        network = dataclasses.replace(network, selector=None, support=None, residual=None)
    elif network.residual is not None:
        network = dataclasses.replace(
            network, residual=dataclasses.replace(network.residual, widths=())
        )
    # Folders that earlier versions prepared from pools only do not have this field.
    checksums = {f"{number}_{scene.name}": scene.checksum() for number, scene in enumerate(scenes)}
    described: dict[str, Any] = {"scene_checksums": checksums} if scenes else {}
    if variables is not None:
        described["selector_checksum"] = _checksum(variables["params"]["selector"])
    varied = ("gamma", "contrast", "brightness", "noise", "noise_probability")
    return {
        "version": occjax.__version__,
        **described,
        "pools": [read_description(Path(pool) / DESCRIPTION) for pool in pools],
        "network": json.loads(config_to_json(network)),
        "seed": seed,
        "augmentation": {name: getattr(augmentation, name) for name in varied},
    }


def _checksum(tree: dict) -> str:
    """Return the SHA-256 of all arrays of a tree, in hexadecimal."""
    checksum = hashlib.sha256()
    for leaf in jax.tree.leaves(tree):
        checksum.update(np.ascontiguousarray(leaf).tobytes())
    return checksum.hexdigest()

"""The paper's networks at a reduced size: trained on a CPU, scored, compared with the paper.

``experiments.ablation`` and ``experiments.interval_study`` call this module with ``--reduced``;
``experiments.reduced_report`` makes the tables and plots. All trainings share one pool of
procedural light fields, batches, steps and schedule; they differ in their network and their seed
only. Folder of the trainings:

* ``pool`` and ``held_out``: procedural light fields to train on and to score;
* ``trainings``: a folder of :func:`occjax.training.train` for each row and seed;
* ``ROW-SEED.jsonl``: what the tables need of a finished row, see :func:`train_and_score`.
"""

from __future__ import annotations

import dataclasses
import json
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import median
from types import MappingProxyType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy import ndimage
from tqdm import tqdm

from experiments.flops import layers
from experiments.networks import TABLE_3
from occjax.data.config import AugmentationConfig
from occjax.data.pool import light_field_files, read_sample, render_pool
from occjax.data.procedural import Defects, SceneConfig, Textures
from occjax.data.samples import LightFieldSample, stack_samples
from occjax.estimators import run_estimator
from occjax.estimators.factory import estimator_of
from occjax.evaluation import evaluate
from occjax.evaluation.metrics import default_border
from occjax.io.atomic import atomic_path
from occjax.lightfield import LightField
from occjax.models import (
    AggregationConfig,
    FeatureConfig,
    OccCasNet,
    OccCasNetConfig,
    evenly_spaced,
    load_weights,
    preset,
)
from occjax.ops import occlusion_weights
from occjax.training import (
    DataConfig,
    LossConfig,
    OptimiserConfig,
    Recipe,
    RunConfig,
    TrainConfig,
    make_source,
    read_log,
    scenes_from_folders,
    train,
)
from occjax.training.data import VALIDATION_SEED
from occjax.training.occcasnet import OccCasNetTask

LOGS = Path(__file__).parent / "reduced"
"""Folder of the committed logs, tables and plots."""

SETS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "procedural": ("procedural",),
        "rendered": tuple(f"s{number}" for number in range(1000, 1008)),
        "antinous": ("antinous",),
    }
)
"""Names of the scenes of each set that is scored; a set's scores are the means over its scenes."""

REGIONS = ("all", "edges", "elsewhere")
"""All pixels, those near depth edges, and the others."""

MEASURES = ("mse_x100", "badpix_0.07", "badpix_0.03", "badpix_0.01", "q25_x100")


@dataclass(frozen=True)
class ReducedConfig:
    """What all rows have in common.

    Attributes:
        views: Grid of views.
        features: Feature network.
        aggregation: Aggregation of every stage.
        attention_width: Hidden units of the channel attention.
        train_count: Number of light fields to train on.
        held_out_count: Number of procedural light fields to score.
        image_size: Side of these light fields, in pixels.
        patch: Side of a training patch, in pixels.
        batch_size: Patches per step.
        steps: Number of steps.
        data_seed: Seed of the light fields, of their order and of their augmentation.
        optimiser: The optimiser.
        ema_decay: Decay of the averaged weights, which are scored.
        edge_step: Difference of the true disparities of neighbouring pixels above which there is a
            depth edge between them, in pixels per view step.
        edge_band: Distance from a depth edge within which a pixel is near it, in pixels.
    """

    views: tuple[int, int] = (5, 5)
    features: FeatureConfig = field(
        default_factory=lambda: FeatureConfig(
            widths=(4, 8, 8, 8), blocks=(1, 1, 1, 1), pooled=(2, 4), fused=8
        )
    )
    aggregation: AggregationConfig = field(default_factory=lambda: AggregationConfig(16, pairs=1))
    attention_width: int = 24
    train_count: int = 1600
    held_out_count: int = 200
    image_size: int = 48
    patch: int = 24
    batch_size: int = 4
    steps: int = 600
    data_seed: int = 0
    optimiser: OptimiserConfig = field(
        default_factory=lambda: OptimiserConfig(
            peak_rate=5e-3, warm_up=50, weight_decay=1e-4, clip=1.0
        )
    )
    ema_decay: float = 0.98
    edge_step: float = 0.25
    edge_band: float = 5.0

    @property
    def scenes(self) -> SceneConfig:
        """Distribution of the procedural light fields.

        They are small and few steps are trained, so that they have few objects, with visible
        texture; a third of them is noisy.
        """
        return SceneConfig(
            image_size=(self.image_size, self.image_size),
            grid=self.views,
            views="all",
            rays=4,
            disparity_range=(-4.0, 4.0),
            disparity_width=(1.0, 6.0),
            walls=2,
            sheets=4,
            solids=2,
            textures=Textures(gradients=0.3),
            curved=0.2,
            low_contrast=0.1,
            textureless=0.02,
            calm=0.0,
            similar=0.1,
            shadows=0.3,
            highlights=0.0,
            reflections=0.0,
            defects=Defects(noise=0.3, vignetting=0.0, blur=0.0, gamma=0.3, quantisation=0.8),
        )


def _single_stage(interval: float) -> OccCasNetConfig:
    candidates = evenly_spaced(-4.0, 4.0, interval)
    return preset("cas_1").with_stages(candidates=candidates)


def _volume(kind: str, base: str) -> OccCasNetConfig:
    return preset(base).with_stages(volume=kind, attention=False)


def _with_visibility() -> OccCasNetConfig:
    network = preset("cas_2_occ")
    first, second = network.stages
    second = dataclasses.replace(second, occlusion="visibility")
    return dataclasses.replace(network, stages=(first, second))


QUESTIONS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "cascade at equal cost": ("cas_1", "cas_2", "cas_3", "cas_4", "interval_1_2"),
        "occlusion weights": ("cas_2", "cas_2_occ", "cas_2_occ_gt", "cas_2_occ_visibility"),
        "transposed warp": ("cas_2_occ", "cas_2_occ_transposed"),
        "shared aggregation": ("cas_2", "cas_2_share"),
        "second interval": (
            *("cas_2", "cas_2_interval_1_2", "cas_2_interval_1_4", "cas_2_interval_1_16"),
        ),
        "first number of candidates": ("cas_2", "cas_2_coarse_17", "cas_2_coarse_33"),
        "volume": ("cas_2_no_attention", "cas_2", "cas_2_statistics", "cas_2_correlation"),
        "volume with occlusion weights": (
            *("cas_2_occ_no_attention", "cas_2_occ"),
            *("cas_2_occ_statistics", "cas_2_occ_correlation"),
        ),
        "interval": ("cas_1", "interval_1_2", "interval_1_4", "interval_1_8"),
    }
)
"""Rows to compare by question; the others are compared with the first one."""

INTERVAL_STUDY = "interval"
"""The question of ``experiments.interval_study``; the others are those of the ablation."""

NETWORKS: Mapping[str, OccCasNetConfig] = MappingProxyType(
    {
        **{name: preset(name) for name in TABLE_3 if name != "occcasnet"},
        "cas_2_occ_visibility": _with_visibility(),
        "cas_2_occ_transposed": preset("cas_2_occ", warp="transposed"),
        "cas_2_no_attention": _volume("concatenate", "cas_2"),
        "cas_2_statistics": _volume("statistics", "cas_2"),
        "cas_2_correlation": _volume("correlation", "cas_2"),
        "cas_2_occ_no_attention": _volume("concatenate", "cas_2_occ"),
        "cas_2_occ_statistics": _volume("statistics", "cas_2_occ"),
        "cas_2_occ_correlation": _volume("correlation", "cas_2_occ"),
        "interval_1_2": _single_stage(1 / 2),
        "interval_1_4": _single_stage(1 / 4),
        "interval_1_8": _single_stage(1 / 8),
    }
)
"""Networks of all rows at full size."""

SEEDS = 3
"""Number of seeds of the rows of the first three questions; the other rows have one."""


def queue(questions: Sequence[str]) -> Iterator[tuple[str, int]]:
    """Yield name and seed of each training, so that the finished ones are always comparable.

    First all rows of the first three questions with seed 0, then with seed 1, and so on; then the
    other rows.

    Args:
        questions: Names in :data:`QUESTIONS`.

    Example:
        >>> list(queue(["transposed warp"]))[:3]
        [('cas_2_occ', 0), ('cas_2_occ_transposed', 0), ('cas_2_occ', 1)]
    """
    several = list(dict.fromkeys(row for name in list(QUESTIONS)[:3] for row in QUESTIONS[name]))
    rows = list(dict.fromkeys(row for name in questions for row in QUESTIONS[name]))
    for seed in range(SEEDS):
        yield from ((row, seed) for row in several if row in rows)
    yield from ((row, 0) for row in rows if row not in several)


def reduced_form(network: OccCasNetConfig, config: ReducedConfig) -> OccCasNetConfig:
    """Return a network with few views and channels; stages and candidates are the same."""
    return dataclasses.replace(
        network.with_stages(aggregation=config.aggregation),
        views=config.views,
        features=config.features,
        attention_width=config.attention_width,
    )


def row_recipe(name: str, seed: int, folder: Path, config: ReducedConfig) -> Recipe:
    """Return the training of a row.

    Args:
        name: Name in :data:`NETWORKS`.
        seed: Seed of the initial weights and of the order of the light fields.
        folder: Folder with the pool.
        config: Settings of all rows.
    """
    augmentation = AugmentationConfig(crop=(config.patch, config.patch))
    return Recipe(
        TrainConfig(
            reduced_form(NETWORKS[name], config),
            LossConfig(),
            config.optimiser,
            steps=config.steps,
            ema_decay=config.ema_decay,
            seed=seed,
        ),
        DataConfig(
            batch_size=config.batch_size,
            procedural_share=0.0,
            scenes=config.scenes,
            pools=(folder / "pool",),
            augmentation=augmentation,
            seed=config.data_seed + seed,
        ),
        RunConfig(checkpoint_minutes=3.0),
    )


def multiply_adds(network: OccCasNetConfig, config: ReducedConfig) -> int:
    """Count the multiply-adds of the layers in a training step: forward, and twice that back."""
    forward = layers(network, (config.patch, config.patch))
    return 3 * config.batch_size * sum(layer.multiply_adds for layer in forward)


def train_and_score(
    folder: Path,
    trainings: Sequence[tuple[str, int]],
    scenes: Sequence[Path] = (),
    config: ReducedConfig = ReducedConfig(),
) -> None:
    """Train rows one after the other and score them; finished ones are left as they are.

    When a row is trained, a file ``ROW-SEED.jsonl`` is written: a line of kind ``row`` with its
    settings, the lines ``train`` of its log, and a line ``scores`` for each scene and region.
    Scenes that are added later are scored with the weights of the finished trainings.

    Args:
        folder: Folder of the trainings; an interrupted training resumes from its checkpoint.
        trainings: Name and seed of each training, in this order.
        scenes: Scenes with ground truth to score, in addition to procedural light fields.
        config: Settings of all rows.

    Raises:
        InputError: If the folder contains other trainings, or a scene cannot be used.
        KeyboardInterrupt: If interrupted or asked to terminate, after the state is saved.
    """
    # Trainings of one network with several seeds share their compiled programs.
    jax.config.update("jax_compilation_cache_dir", str((folder / "cache").resolve()))
    light_fields = scenes_from_folders(scenes)
    render_pool(folder / "pool", config.train_count, config.scenes, config.data_seed)
    held_out_seed = config.data_seed + VALIDATION_SEED
    render_pool(folder / "held_out", config.held_out_count, config.scenes, held_out_seed)
    files = light_field_files(folder / "held_out")[: config.held_out_count]
    held_out = stack_samples([read_sample(file) for file in files])
    for name, seed in trainings:
        log = folder / f"{name}-{seed}.jsonl"
        entries = read_entries(log)
        if not entries:
            entries = _train_row(name, seed, folder, config)
            _write_entries(log, entries)
        network = reduced_form(NETWORKS[name], config)
        done = {entry["scene"] for entry in entries if entry["kind"] == "scores"}
        missing = [each for each in light_fields if each.name not in done]
        if network.needs_visibility:  # known of procedural light fields only
            missing = []
        if "procedural" in done and not missing:
            continue
        weights = folder / "trainings" / f"{name}-{seed}" / "weights.safetensors"
        variables = load_weights(weights, network)[0]
        if "procedural" not in done:
            entries += score_patches(variables, network, held_out, config)
        for light_field in missing:
            entries += _score_scene(variables, network, light_field, config)
        _write_entries(log, entries)
        jax.clear_caches()
        tqdm.write(f"{log}: finished", file=sys.stderr)


def _train_row(name: str, seed: int, folder: Path, config: ReducedConfig) -> list[dict[str, Any]]:
    """Train a row, or resume its training; return the first entries of its file."""
    recipe = row_recipe(name, seed, folder, config)
    where = folder / "trainings" / f"{name}-{seed}"
    trained = train(
        recipe.train,
        make_source(recipe.data, recipe.train.network),
        where,
        run=recipe.run,
        data=asdict(recipe.data),
        say=lambda line: tqdm.write(f"{where.name}: {line}", file=sys.stderr),
    )
    if not trained.finished:  # the process was asked to terminate, and has saved its state
        raise KeyboardInterrupt
    row = {
        "kind": "row",
        "row": name,
        "seed": seed,
        "multiply_adds": multiply_adds(recipe.train.network, config),
        "config": json.loads(json.dumps(asdict(config))),
    }
    kept = ("kind", "step", "loss", "badpix", "seconds_per_step")
    steps = [entry for entry in read_log(where) if entry["kind"] == "train"]
    return [row, *({key: entry[key] for key in kept} for entry in steps)]


def near_edges(truth: np.ndarray, config: ReducedConfig) -> np.ndarray:
    """Return ``[H, W]`` whether a pixel is near a depth edge of the true disparity ``[H, W]``.

    Example:
        >>> truth = np.zeros((1, 20))
        >>> truth[:, 10:] = 1.0  # an edge between columns 9 and 10
        >>> np.flatnonzero(near_edges(truth, ReducedConfig())[0]).tolist()
        [4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15]
    """
    edge = np.zeros(truth.shape, bool)
    across = np.abs(np.diff(truth, axis=1)) > config.edge_step
    down = np.abs(np.diff(truth, axis=0)) > config.edge_step
    for part, found in (
        (edge[:, 1:], across),
        (edge[:, :-1], across),
        (edge[1:], down),
        (edge[:-1], down),
    ):
        part |= found
    if not edge.any():
        return edge
    return ndimage.distance_transform_edt(~edge) <= config.edge_band


def score_patches(
    variables: dict, network: OccCasNetConfig, samples: LightFieldSample, config: ReducedConfig
) -> list[dict[str, Any]]:
    """Score a network on a batch of light fields together.

    Args:
        variables: Variables of the network.
        network: The network.
        samples: ``[n, ...]`` light fields.
        config: Settings of the regions.

    Returns:
        A line of the log for each region, one with the CPU time of this process per megapixel, and
        one of :func:`weight_on_hidden_views` if the last stage computes occlusion maps.
    """
    known = OccCasNetTask(network, LossConfig(), "float32").truth_arguments

    @jax.jit
    def estimate(sample):
        last = OccCasNet(network).apply(variables, sample.views, **known(sample))[-1]
        return last.disparity, last.occlusion

    maps, occlusion, seconds = [], [], []
    for number in range(len(samples.disparity)):
        sample = jax.tree.map(lambda values, number=number: values[number], samples)
        begin = time.process_time()
        disparity_map, occlusion_maps = jax.block_until_ready(estimate(sample))
        seconds.append(time.process_time() - begin)
        maps.append(np.asarray(disparity_map))
        occlusion.append(occlusion_maps)
    disparity = np.stack(maps)
    timing = 1e6 * median(seconds) / maps[0].size  # the first one includes the compilation
    truth = np.where(samples.valid, samples.disparity, np.nan)
    edges = np.stack([near_edges(each, config) for each in truth])
    border = default_border(truth.shape[1:])
    inside = np.zeros(truth.shape, bool)
    inside[:, border : truth.shape[1] - border, border : truth.shape[2] - border] = True
    stacked = (each.reshape(-1, truth.shape[2]) for each in (disparity, truth, edges, inside))
    scores = region_scores("procedural", *stacked)
    lines = [*scores, {"kind": "time", "seconds_per_megapixel": round(timing, 3)}]
    if network.stages[-1].occlusion in ("coarse", "ground_truth"):
        lines.append(weight_on_hidden_views(np.stack(occlusion), samples, edges))
    return lines


def weight_on_hidden_views(
    maps: np.ndarray, samples: LightFieldSample, edges: np.ndarray
) -> dict[str, Any]:
    """Measure how well the weights of equation 6 tell hidden views from others.

    Args:
        maps: ``[n, v, u, h, w]`` occlusion maps (eqs. 4 and 5).
        samples: ``[n, ...]`` light fields with exact visibility.
        edges: ``[n, h, w]`` whether a pixel is near a depth edge.

    Returns:
        A line of the log, of kind ``weights``: over the pixels near depth edges that a view does
        not see, the mean fraction of these views, and the mean share of the weight that they have.
    """
    weights, hidden = np.asarray(occlusion_weights(jnp.asarray(maps))), ~samples.visibility
    fraction = hidden.mean((1, 2))
    share = (weights * hidden).sum((1, 2)) / np.maximum(weights.sum((1, 2)), 1e-6)
    counted = edges & samples.valid & (fraction > 0.0)
    return {
        "kind": "weights",
        "hidden_views": round(float(fraction[counted].mean()), 4),
        "weight_on_hidden": round(float(share[counted].mean()), 4),
    }


def _score_scene(
    variables: dict, network: OccCasNetConfig, scene: LightField, config: ReducedConfig
) -> list[dict[str, Any]]:
    """Score a network on a scene, with the border of ``occjax estimate``."""
    truth = scene.ground_truth
    assert truth is not None
    disparity = run_estimator(estimator_of(network, variables), scene).disparity
    border = default_border(truth.shape)
    inside = np.zeros(truth.shape, bool)
    inside[border : truth.shape[0] - border, border : truth.shape[1] - border] = True
    return region_scores(scene.name, disparity, truth, near_edges(truth, config), inside)


def region_scores(
    scene: str, disparity: np.ndarray, truth: np.ndarray, edges: np.ndarray, inside: np.ndarray
) -> list[dict[str, Any]]:
    """Score a disparity map in each region.

    Args:
        scene: Name of the scene.
        disparity: ``[H, W]`` estimate, pixels per view step.
        truth: ``[H, W]`` true disparity, NaN where it is unknown.
        edges: ``[H, W]`` whether a pixel is near a depth edge.
        inside: ``[H, W]`` whether a pixel is compared.

    Returns:
        A line of the log for each region with known disparities.
    """
    masks = dict(zip(REGIONS, (inside, inside & edges, inside & ~edges), strict=True))
    lines = []
    for region, mask in masks.items():
        if not (mask & np.isfinite(truth)).any():
            continue
        metrics = evaluate(disparity, truth, border=0, mask=mask)
        badpix = {f"badpix_{limit:g}": value for limit, value in metrics.badpix.items()}
        values = {"mse_x100": metrics.mse_x100, **badpix, "q25_x100": metrics.q25_x100}
        rounded = {name: round(value, 4) for name, value in values.items()}
        lines.append({"kind": "scores", "scene": scene, "region": region, **rounded})
    return lines


def read_entries(log: Path) -> list[dict[str, Any]]:
    """Return the lines of a row's file; none if there is no file."""
    if not log.is_file():
        return []
    return [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]


def _write_entries(log: Path, entries: Sequence[Mapping[str, Any]]) -> None:
    with atomic_path(log) as temporary:
        lines = "".join(json.dumps(entry) + "\n" for entry in entries)
        temporary.write_text(lines, encoding="utf-8")

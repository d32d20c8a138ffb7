"""The paper's networks at a reduced size: trained on a CPU, scored, compared with the paper.

``experiments.ablation`` and ``experiments.interval_study`` call this module with ``--reduced``. All
trainings share one pool of procedural light fields, batches, steps and schedule; they differ in
their network and their seed only. Folder of the trainings:

* ``pool`` and ``held_out``: procedural light fields to train on and to score;
* ``trainings``: a folder of :func:`occjax.training.train` for each row and seed;
* ``ROW-SEED.jsonl``: what the tables need of a finished row, see :func:`train_and_score`.
"""

from __future__ import annotations

import csv
import dataclasses
import json
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import mean, median, stdev
from types import MappingProxyType
from typing import Annotated, Any, NamedTuple

import jax
import numpy as np
from matplotlib.figure import Figure
from scipy import ndimage, stats
from tqdm import tqdm
from tyro.conf import arg

from experiments.flops import layers
from experiments.markdown import markdown_table, write_text
from experiments.networks import TABLE_3
from experiments.training_rows import Training, select_rows
from occjax.data.config import AugmentationConfig
from occjax.data.pool import light_field_files, read_sample, render_pool
from occjax.data.procedural import Defects, SceneConfig, Textures
from occjax.data.samples import LightFieldSample, stack_samples
from occjax.errors import InputError
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
from occjax.viz.canvas import save

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


Reduced = Annotated[bool, arg(help="Networks of a reduced size; without FOLDER, committed logs.")]
"""Type of the option ``--reduced``."""


def run_reduced(
    folder: Path | None,
    questions: Sequence[str],
    training: Training,
    stem: str,
    rows: Sequence[str] = (),
) -> str:
    """Train and score the rows of questions, and return their tables.

    Args:
        folder: Folder of the trainings; None uses the committed logs without any training.
        questions: Names in :data:`QUESTIONS`.
        training: Options of the command line, of which ``validate`` and ``show`` are used.
        stem: Name of the tables and plots in the folder, without suffix.
        rows: Rows to train; by default all.

    Returns:
        The tables as Markdown.

    Raises:
        InputError: If there is no row of a name, or see :func:`train_and_score`.
    """
    select_rows(rows, NETWORKS)
    if folder is None:
        return report(read_results(LOGS), questions)
    if not training.show:
        todo = [each for each in queue(questions) if not rows or each[0] in rows]
        train_and_score(folder, todo, training.validate)
    return write_report(folder, questions, stem)


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
        A line of the log for each region, and one with the CPU time of this process per megapixel.
    """
    known = OccCasNetTask(network, LossConfig(), "float32").truth_arguments

    @jax.jit
    def estimate(sample):
        outputs = OccCasNet(network).apply(variables, sample.views, **known(sample))
        return outputs[-1].disparity

    maps, seconds = [], []
    for number in range(len(samples.disparity)):
        sample = jax.tree.map(lambda values, number=number: values[number], samples)
        begin = time.process_time()
        maps.append(np.asarray(estimate(sample)))
        seconds.append(time.process_time() - begin)
    disparity = np.stack(maps)
    timing = 1e6 * median(seconds) / maps[0].size  # the first one includes the compilation
    truth = np.where(samples.valid, samples.disparity, np.nan)
    edges = np.stack([near_edges(each, config) for each in truth])
    border = default_border(truth.shape[1:])
    inside = np.zeros(truth.shape, bool)
    inside[:, border : truth.shape[1] - border, border : truth.shape[2] - border] = True
    stacked = (each.reshape(-1, truth.shape[2]) for each in (disparity, truth, edges, inside))
    scores = region_scores("procedural", *stacked)
    return [*scores, {"kind": "time", "seconds_per_megapixel": round(timing, 3)}]


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


class Result(NamedTuple):
    """Result of a row: its scores by seed.

    Attributes:
        name: Name of the row.
        multiply_adds: Multiply-adds of a training step.
        seconds: CPU seconds of an estimate per megapixel; None if unknown.
        seeds: For each seed, scores by set, region and measure.
        halfway: Mean BadPix 0.07 of the training batches of the first seed before half of the
            steps, and at the end.
    """

    name: str
    multiply_adds: int
    seconds: float | None
    seeds: tuple[Mapping[tuple[str, str, str], float], ...]
    halfway: tuple[float, float] | None

    def values(self, group: str, region: str, measure: str) -> list[float]:
        """Return a score of each seed that has it."""
        key = (group, region, measure)
        return [scores[key] for scores in self.seeds if key in scores]


def read_results(folder: Path) -> dict[str, Result]:
    """Read the logs of all finished rows of a folder, by name.

    Args:
        folder: Folder with files ``ROW-SEED.jsonl``.

    Raises:
        InputError: If rows were trained with different settings.
    """
    found: dict[str, Result] = {}
    configs = []
    for name in NETWORKS:
        logs = [read_entries(path) for path in sorted(folder.glob(f"{name}-[0-9].jsonl"))]
        logs = [log for log in logs if any(entry["kind"] == "scores" for entry in log)]
        if logs:
            configs += [log[0]["config"] for log in logs]
            times = [
                line["seconds_per_megapixel"]
                for log in logs
                for line in log
                if line["kind"] == "time"
            ]
            found[name] = Result(
                name,
                logs[0][0]["multiply_adds"],
                median(times) if times else None,
                tuple(_by_set(log) for log in logs),
                _halfway(logs[0]),
            )
    if any(config != configs[0] for config in configs):
        raise InputError(f"{folder}: rows were trained with different settings; train them again")
    return found


def _by_set(log: Sequence[Mapping[str, Any]]) -> dict[tuple[str, str, str], float]:
    """Return the mean of each score over the scenes of a set, for the sets that are complete."""
    lines = {(line["scene"], line["region"]): line for line in log if line["kind"] == "scores"}
    scores = {}
    for group, scenes in SETS.items():
        for region in REGIONS:
            if all((scene, region) in lines for scene in scenes):
                for measure in MEASURES:
                    values = [lines[scene, region][measure] for scene in scenes]
                    scores[group, region, measure] = mean(values)
    return scores


def _halfway(log: Sequence[Mapping[str, Any]]) -> tuple[float, float] | None:
    """Return the mean BadPix 0.07 of training in the last fifth of the first half, and of all."""
    lines = [line for line in log if line["kind"] == "train"]
    if not lines:
        return None
    steps = lines[-1]["step"]

    def until(last):
        return mean(x["badpix"] for x in lines if last - 0.2 * steps < x["step"] <= last)

    return until(0.5 * steps), until(steps)


def order_stability(results: Mapping[str, Result]) -> str:
    """Say how similar the order of the rows is at half of the steps and at the end.

    All rows train on the same batches, so that their errors on these can be compared.
    """
    pairs = [row.halfway for row in results.values() if row.halfway is not None]
    if len(pairs) < 3:
        return ""
    half, full = np.transpose(pairs)
    rank = stats.spearmanr(half, full).statistic
    return (
        "Between half of the steps and the end, the mean BadPix 0.07 of the training batches "
        f"falls from {half.mean():.1f} to {full.mean():.1f}; the rank correlation of the "
        f"{len(pairs)} rows is {rank:.2f}."
    )


def spread_of_seeds(
    results: Mapping[str, Result], group: str, region: str, measure: str
) -> float | None:
    """Return the standard deviation over seeds, pooled over the rows with several seeds.

    Returns:
        Root of the mean variance; None if no row has several seeds.
    """
    several = [row.values(group, region, measure) for row in results.values()]
    variances = [stdev(values) ** 2 for values in several if len(values) > 1]
    return mean(variances) ** 0.5 if variances else None


def compare_rows(difference: float, spread: float | None) -> str:
    """Return whether an error is ``"lower"`` or ``"higher"``, or ``"none"`` within the spread.

    Example:
        >>> compare_rows(-0.3, 0.2), compare_rows(0.1, 0.2), compare_rows(0.1, None)
        ('lower', 'none', 'not known')
    """
    if spread is None:
        return "not known"
    if abs(difference) <= spread:
        return "none"
    return "lower" if difference < 0.0 else "higher"


HEAD = (
    *(
        "row",
        "seeds",
        "multiply-adds per step",
        "CPU s per megapixel",
        "MSE x100",
        "BadPix 0.07",
        "BadPix 0.03",
    ),
    *("BadPix 0.01", "Q25 x100", "BadPix 0.07 at edges", "BadPix 0.07 elsewhere"),
    *(
        "against the first row: all, edges, elsewhere",
        "paper's BadPix 0.07",
        "paper against its first row",
        "agrees",
    ),
)


def question_table(results: Mapping[str, Result], question: str, group: str) -> str | None:
    """Return the finished rows of a question on one set, as Markdown.

    Args:
        results: Results by row.
        question: Name in :data:`QUESTIONS`.
        group: Name in :data:`SETS`.

    Returns:
        The table; None if no row has scores on the set.
    """
    main = ("all", "badpix_0.07")
    names = [name for name in QUESTIONS[question] if name in results]
    rows = [results[name] for name in names if results[name].values(group, *main)]
    if not rows:
        return None
    first = QUESTIONS[question][0]
    lines = []
    for row in rows:
        cells = [f"`{row.name}`", str(len(row.values(group, *main)))]
        cells.append(f"{row.multiply_adds / 1e9:.2f} G")
        cells.append("" if row.seconds is None else f"{row.seconds:.1f}")
        cells += [_with_spread(row.values(group, "all", measure)) for measure in MEASURES]
        cells += [_with_spread(row.values(group, part, main[1])) for part in REGIONS[1:]]
        found, paper = [], ""
        if row.name != first and first in results:
            for part in REGIONS:
                own, base = (each.values(group, part, main[1]) for each in (row, results[first]))
                if own and base:
                    spread = spread_of_seeds(results, group, part, main[1])
                    found.append(compare_rows(mean(own) - mean(base), spread))
            if row.name in TABLE_3 and first in TABLE_3:
                difference = _published(row.name) - _published(first)
                paper = "lower" if difference < 0.0 else "higher"
        published = f"{_published(row.name):.3f}" if row.name in TABLE_3 else ""
        agrees = ""
        if found and paper:
            known = found[0] in ("lower", "higher")
            agrees = ("yes" if found[0] == paper else "no") if known else found[0]
        lines.append([*cells, ", ".join(found), published, paper, agrees])
    return markdown_table(HEAD, lines, right=True)


def report(results: Mapping[str, Result], questions: Sequence[str]) -> str:
    """Return all tables as Markdown, one for each question and set."""
    parts = []
    for question in questions:
        for group in SETS:
            table = question_table(results, question, group)
            if table is not None:
                parts.append(f"### {question.capitalize()}: {group}\n\n{table}")
    parts.append(order_stability(results) if parts else "No row is finished.")
    return "\n\n".join(part for part in parts if part)


def write_scores(results: Mapping[str, Result], path: Path) -> None:
    """Write every score of every row and seed to a CSV file."""
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["row", "seed", "multiply_adds", "set", "region", *MEASURES])
        for row in results.values():
            for seed, scores in enumerate(row.seeds):
                for group, region in dict.fromkeys((key[0], key[1]) for key in scores):
                    values = [scores[group, region, measure] for measure in MEASURES]
                    writer.writerow([row.name, seed, row.multiply_adds, group, region, *values])


def figure(results: Mapping[str, Result], questions: Sequence[str], group: str) -> Figure:
    """Plot BadPix 0.07 of each row by region, one panel for each question; a dot is a seed."""
    shown = [
        (question, [name for name in QUESTIONS[question] if name in results])
        for question in questions
    ]
    shown = [(question, names) for question, names in shown if names]
    heights = [len(names) + 1 for _, names in shown]
    picture = Figure(figsize=(6.5, 0.3 * sum(heights) + 1), layout="constrained")
    picture.set_facecolor("white")
    panels = picture.subplots(
        len(shown), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights}
    )
    colours = dict(zip(REGIONS, ("#222222", "#c0504d", "#2a6fbb"), strict=True))
    for axes, (question, names) in zip(panels[:, 0], shown, strict=True):
        for place, name in enumerate(names):
            for region, colour in colours.items():
                values = results[name].values(group, region, "badpix_0.07")
                axes.plot(values, [place] * len(values), "o", ms=4, color=colour, alpha=0.7)
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.5, -0.5)
        axes.set_title(question, loc="left", fontsize="medium")
        axes.grid(axis="x", alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    panels[-1, 0].set_xlabel(f"BadPix 0.07 [%] on the set {group}")
    handles = [
        panels[0, 0].plot([], [], "o", color=colour, label=region)[0]
        for region, colour in colours.items()
    ]
    picture.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    return picture


def write_report(folder: Path, questions: Sequence[str], stem: str) -> str:
    """Read the logs of a folder, and write the tables and the plot into it.

    Args:
        folder: Folder with the logs.
        questions: Questions to report.
        stem: Name of the files without suffix.

    Returns:
        The tables as Markdown.
    """
    results = read_results(folder)
    text = report(results, questions)
    if results:
        write_text(folder / f"{stem}.md", text)
        rows = {row for question in questions for row in QUESTIONS[question]}
        write_scores({n: r for n, r in results.items() if n in rows}, folder / f"{stem}.csv")
        save(figure(results, questions, "procedural"), folder / f"{stem}.png")
    return text


def _published(name: str) -> float:
    badpix = TABLE_3[name].badpix
    assert badpix is not None
    return badpix


def _with_spread(values: Sequence[float]) -> str:
    if not values:
        return ""
    shown = f"{mean(values):.2f}"
    return shown if len(values) == 1 else f"{shown} ± {stdev(values):.2f}"

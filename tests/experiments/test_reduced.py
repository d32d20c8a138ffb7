"""Reduced trainings: order, resuming, scores by region, and tables from logs."""

import dataclasses
import json
from types import SimpleNamespace

import numpy as np
import pytest

from experiments import ablation, reduced, reduced_report
from experiments.networks import small_form
from experiments.reduced import NETWORKS, QUESTIONS, ReducedConfig
from experiments.training_rows import Training
from occjax.data.pool import write_sample
from occjax.data.samples import numpy_sample
from occjax.errors import InputError
from occjax.lightfield import view_offsets
from occjax.models import AggregationConfig
from tests.scenes import plane

CONFIG = ReducedConfig(train_count=1, held_out_count=1, steps=2)


def write_log(folder, row, seed, *, everywhere, edges=50.0, config=CONFIG, scene="procedural"):
    """Write the log of a finished row with the given BadPix 0.07."""
    lines = [{"kind": "row", "row": row, "multiply_adds": 2e9, "config": {"steps": config.steps}}]
    for region, bad in (("all", everywhere), ("edges", edges), ("elsewhere", 0.0)):
        scores = dict.fromkeys(reduced.MEASURES, 1.0) | {"badpix_0.07": bad}
        lines.append({"kind": "scores", "scene": scene, "region": region, **scores})
    text = "".join(json.dumps(line) + "\n" for line in lines)
    (folder / f"{row}-{seed}.jsonl").write_text(text)


@pytest.fixture
def pools(monkeypatch):
    """Replace the rendering of light fields, whose compilation takes minutes."""

    def render(folder, count, scenes, seed):
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "pool.json").write_text("{}")
        shape = (*scenes.grid, *scenes.image_size)
        for number in range(count):
            views = np.random.default_rng(number).random(shape, np.float32)
            disparity = np.full(scenes.image_size, 0.5, np.float32)
            sample = numpy_sample(views, view_offsets(*scenes.grid), disparity)
            write_sample(folder / f"{number:06d}.npz", sample)

    monkeypatch.setattr(reduced, "render_pool", render)


@pytest.fixture
def fakes(monkeypatch, pools):
    """Replace training and scoring, too; return the names of the trainings in order."""
    started = []

    def train(config, source, folder, **options):
        started.append(folder.name)
        folder.mkdir(parents=True, exist_ok=True)
        line = {"kind": "train", "step": 2, "loss": 0.5, "badpix": 9.0, "seconds_per_step": 0.1}
        (folder / "log.jsonl").write_text(json.dumps(line) + "\n")
        return SimpleNamespace(finished=len(started) != 2)  # the second one is interrupted

    def scores(*_):
        return [{"kind": "scores", "scene": "procedural", "region": "all", "badpix_0.07": 3.0}]

    monkeypatch.setattr(reduced, "train", train)
    monkeypatch.setattr(reduced, "load_weights", lambda *_: [None])
    monkeypatch.setattr(reduced, "score_patches", scores)
    return started


def test_interrupted_queue_resumes_and_trains_no_finished_row_again(fakes, tmp_path):
    trainings = [("cas_1", 0), ("cas_2", 0), ("cas_1", 1)]
    with pytest.raises(KeyboardInterrupt):
        reduced.train_and_score(tmp_path, trainings, config=CONFIG)
    assert fakes == ["cas_1-0", "cas_2-0"]
    assert not (tmp_path / "cas_2-0.jsonl").exists()
    first = (tmp_path / "cas_1-0.jsonl").read_text()
    reduced.train_and_score(tmp_path, trainings, config=CONFIG)
    assert fakes == ["cas_1-0", "cas_2-0", "cas_2-0", "cas_1-1"]
    assert (tmp_path / "cas_1-0.jsonl").read_text() == first
    reduced.train_and_score(tmp_path, trainings, config=CONFIG)
    assert len(fakes) == 4
    kinds = [line["kind"] for line in reduced.read_entries(tmp_path / "cas_2-0.jsonl")]
    assert kinds == ["row", "train", "scores"]


def test_queue_finishes_comparable_rows_first():
    trainings = list(reduced.queue(list(QUESTIONS)))
    assert {name for name, _ in trainings} == set(NETWORKS)
    assert len(set(trainings)) == len(trainings) == 9 * 3 + 14
    several = {row for name in list(QUESTIONS)[:3] for row in QUESTIONS[name]}
    assert [{name for name, _ in trainings[i : i + 9]} for i in (0, 9, 18)] == [several] * 3
    assert [seed for _, seed in trainings[27:]] == [0] * 14


def test_rows_differ_in_network_and_seed_only(tmp_path):
    one = reduced.row_recipe("cas_2", 0, tmp_path, CONFIG)
    other = reduced.row_recipe("cas_2_occ", 2, tmp_path, CONFIG)
    stages = [stage.candidates for stage in NETWORKS["cas_2_occ"].stages]
    assert [stage.candidates for stage in other.train.network.stages] == stages
    assert dataclasses.replace(other.train, network=one.train.network, seed=0) == one.train
    assert dataclasses.replace(other.data, seed=0) == one.data


def test_table_compares_with_the_first_row_and_the_paper(tmp_path):
    for seed in range(3):
        write_log(tmp_path, "cas_1", seed, everywhere=10.0 + seed)
        write_log(tmp_path, "cas_2", seed, everywhere=8.0 + seed)
        write_log(tmp_path, "cas_3", seed, everywhere=10.5 + seed)
        write_log(tmp_path, "cas_4", seed, everywhere=14.0 + seed)
    # Lower than the mean of the first row by more than the spread, but not than its first seed.
    write_log(tmp_path, "interval_1_2", 0, everywhere=9.5)
    results = reduced_report.read_results(tmp_path)
    # The variance of each row is 1, and so is the pooled spread.
    spread = reduced_report.spread_of_seeds(results, "procedural", "all", "badpix_0.07")
    assert spread == pytest.approx(1.0)
    question = "cascade at equal cost"
    rows = cells(reduced_report.rows_table(results, question))
    assert rows[1][:3] == ["`cas_2`", "3", "2.00 G"]
    assert [row[4:] for row in rows] == [
        ["2.804", ""],
        ["2.511", "yes, not known, not known"],
        ["2.704", "none, not known, not known"],
        ["2.650", "no, not known, not known"],
        ["", ""],
    ]
    scores = cells(reduced_report.scores_table(results, question))
    assert {row[1] for row in scores} == {"procedural"}
    assert scores[1][2:4] == ["1.00 ± 0.00", "9.00 ± 1.00"]
    assert [row[7] for row in scores] == ["50.00 ± 0.00"] * 4 + ["50.00"]  # at edges
    assert [row[9] for row in scores] == [
        *("", "lower, none, none", "none, none, none", "higher, none, none", "none, none, none")
    ]


def cells(table):
    """Return the cells of the rows of a Markdown table."""
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()[2:]]


def test_report_is_written_from_the_logs_alone(tmp_path, capsys):
    write_log(tmp_path, "cas_2", 0, everywhere=8.0)
    write_log(tmp_path, "cas_2_share", 0, everywhere=7.0)
    ablation.run(tmp_path, training=Training(show=True), reduced=True)
    printed = capsys.readouterr().out
    assert "### Shared aggregation\n" in printed
    assert "not known, not known, not known |" in printed  # one seed has no spread
    assert (tmp_path / "ablation.md").read_text() == printed
    rows = (tmp_path / "ablation.csv").read_text().splitlines()
    assert rows[1].startswith("cas_2,0,2000000000.0,procedural,all,1.0,8.0,")
    assert (tmp_path / "ablation.png").stat().st_size > 0


def test_rows_of_different_settings_are_not_compared(tmp_path):
    write_log(tmp_path, "cas_1", 0, everywhere=8.0)
    write_log(tmp_path, "cas_2", 0, everywhere=8.0, config=ReducedConfig(steps=9))
    with pytest.raises(InputError, match="different settings"):
        reduced_report.read_results(tmp_path)


def test_order_at_half_of_the_steps_is_compared_with_the_end(tmp_path):
    halves = {"cas_1": (30.0, 20.0), "cas_2": (28.0, 10.0), "cas_3": (20.0, 15.0)}
    for row, (half, full) in halves.items():
        write_log(tmp_path, row, 0, everywhere=8.0)
        lines = [
            {"kind": "train", "step": step, "badpix": bad, "seconds_per_step": 36.0}
            for step, bad in ((30, 99.0), (50, half), (80, 99.0), (100, full))
        ]
        with (tmp_path / f"{row}-0.jsonl").open("a") as file:
            file.writelines(json.dumps(line) + "\n" for line in lines)
    results = reduced_report.read_results(tmp_path)
    text = reduced_report.order_stability(results)
    # Ranks 3 2 1 and 3 1 2: a correlation of 0.5.
    assert "falls from 26.0 to 15.0; the rank correlation of the 3 rows is 0.50." in text
    assert reduced_report.hours_text(results) == "The 3 trainings took 3.0 hours."


def test_a_set_without_all_its_scenes_has_no_scores(tmp_path):
    write_log(tmp_path, "cas_1", 0, everywhere=8.0, scene="s1000")
    (row,) = reduced_report.read_results(tmp_path).values()
    assert not row.values("rendered", "all", "badpix_0.07")
    assert not row.values("procedural", "all", "badpix_0.07")


def test_scores_are_apart_near_edges_and_elsewhere():
    truth = np.zeros((1, 8, 20))
    truth[..., 10:] = 1.0
    edges = reduced.near_edges(truth[0], CONFIG)
    disparity = truth[0] + np.where(edges, 0.05, 0.0)
    lines = reduced.region_scores("plane", disparity, truth[0], edges, np.ones((8, 20), bool))
    bad = {line["region"]: line["badpix_0.03"] for line in lines}
    assert bad == {"all": 60.0, "edges": 100.0, "elsewhere": 0.0}  # 12 of 20 columns
    assert [line["mse_x100"] for line in lines] == [0.15, 0.25, 0.0]


def test_patches_are_scored_without_their_border(monkeypatch):
    class Constant:
        """Network whose disparity is 0.05 everywhere."""

        def __init__(self, config):
            pass

        def apply(self, variables, views, **known):
            return [SimpleNamespace(disparity=0.0 * views[2, 2] + 0.05, occlusion=None)]

    monkeypatch.setattr(reduced, "OccCasNet", Constant)
    views = np.zeros((2, 5, 5, 16, 16), np.float32)
    truth = np.full((2, 16, 16), 9.0, np.float32)
    truth[:, 2:-2, 2:-2] = 0.0  # the border is an eighth of the size
    samples = numpy_sample(views, np.zeros((2, 5, 5, 2), np.float32), truth)
    network = reduced.reduced_form(NETWORKS["cas_2"], CONFIG)
    *lines, timing = reduced.score_patches({}, network, samples, CONFIG)
    assert [line["region"] for line in lines] == ["all", "edges"]  # all is near the border
    assert [line["mse_x100"] for line in lines] == [0.25] * 2
    assert timing["seconds_per_megapixel"] >= 0.0


def test_weight_on_hidden_views_is_their_share_of_the_weights():
    truth = np.zeros((1, 8, 20), np.float32)
    truth[..., 10:] = 1.0
    edges = reduced.near_edges(truth[0], CONFIG)[None]
    views = np.zeros((1, 5, 5, 8, 20), np.float32)
    visible = np.ones((1, 5, 5, 8, 20), bool)
    visible[:, 0, :, :, 9] = False  # the first row of views does not see this column
    sample = numpy_sample(views, np.zeros((1, 5, 5, 2), np.float32), truth, visibility=visible)
    maps = views.copy()
    maps[:, :2] = 0.5  # in the upper rows of views
    line = reduced.weight_on_hidden_views(maps, sample, edges)
    # Weights (eq. 6) are 0.25 in 10 views and 1 in 15: five hidden ones have 1.25 of 17.5.
    assert line == {"kind": "weights", "hidden_views": 0.2, "weight_on_hidden": 0.0714}


@pytest.mark.slow
def test_row_is_trained_and_scored_on_all_scenes(pools, tmp_path):
    light_field = plane(grid=(3, 3), size=(20, 24))
    scene = tmp_path / "plane.npz"
    np.savez(scene, views=light_field.views, ground_truth=light_field.ground_truth)
    config = ReducedConfig(
        views=(3, 3),
        features=small_form(NETWORKS["cas_1"]).features,
        aggregation=AggregationConfig(4, pairs=0),
        train_count=2,
        held_out_count=2,
        image_size=16,
        patch=12,
        batch_size=2,
        steps=2,
    )
    folder = tmp_path / "runs"
    reduced.train_and_score(folder, [("cas_2_occ_visibility", 0)], [scene], config)
    lines = reduced.read_entries(folder / "cas_2_occ_visibility-0.jsonl")
    # Visibility is known of procedural light fields only; these have no edges.
    found = [(line["scene"], line["region"]) for line in lines if line["kind"] == "scores"]
    assert found == [("procedural", "all"), ("procedural", "elsewhere")]
    reduced.train_and_score(folder, [("cas_2_correlation", 0)], [], config)
    reduced.train_and_score(folder, [("cas_2_correlation", 0)], [scene], config)
    lines = reduced.read_entries(folder / "cas_2_correlation-0.jsonl")
    scenes = {line["scene"] for line in lines if line["kind"] == "scores"}
    assert scenes == {"procedural", "plane"}

"""Published numbers in the table, XLA's analysis, and measurements."""

from types import SimpleNamespace

import jax
import pytest

from experiments import efficiency_table
from experiments.efficiency_table import deviations, flops_by_xla
from experiments.measuring import measure
from experiments.networks import TABLE_3, small_form
from occjax.errors import InputError
from occjax.models import preset


@pytest.mark.slow
def test_published_numbers_are_reproduced_without_measured_times(capsys):
    rows = efficiency_table.run(networks=("occcasnet", "cas_1"))
    printed = capsys.readouterr().out.splitlines()
    head, _, *cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in printed[:4]]
    assert cells[0][:8] == (
        ["OccCasNet", "`occcasnet`", "33, 9", "1/4, 1/8", *["4.79 M"] * 2, *["13.2 T"] * 2]
    )
    assert cells[1][:8] == ["Cas_1", "`cas_1`", "9", "1", *["2.41 M"] * 2, *["3.11 T"] * 2]
    assert head[-1] == "seconds (paper)"
    assert "seconds" not in head
    assert [row[-1] for row in cells] == ["1.13", ""]
    assert "All published parameters and FLOPs are reproduced" in printed[-1]
    assert all(row.flops_inside == pytest.approx(row.flops_xla, rel=0.02) for row in rows)


def test_deviation_from_a_published_number_is_reported():
    (row,) = efficiency_table.run(networks=("cas_1",))
    assert deviations([row]) == []
    other = row._replace(published=TABLE_3["cas_1"]._replace(tera_flops="3.00"))
    assert deviations([other]) == ["cas_1: FLOPs 3.11, not 3.00 (+3.7 %)"]


@pytest.mark.slow
def test_smoke_test_measures_its_networks(capsys):
    (row,) = efficiency_table.run(networks=("cas_2_occ_gt",), small=True)
    assert row.published is None
    assert row.measured.seconds > 0.0
    # A process with JAX, and the smaller volume of 9 x 32 x 32 x 36 float32.
    assert row.measured.memory > 50e6 + 9 * 32 * 32 * 36 * 4
    table = capsys.readouterr().out.splitlines()
    assert f"| {row.measured.seconds:.3g} |" in table[2]
    assert f"| {row.measured.memory / 1e9:.2f} GB |" in table[2]


def test_program_with_a_loop_is_rejected(monkeypatch):
    def apply(variables, views, **options):
        disparity = jax.lax.fori_loop(0, 5, lambda step, x: 2.0 * x, views[0, 0])
        return (SimpleNamespace(disparity=disparity),)

    network = SimpleNamespace(apply=apply)
    monkeypatch.setattr(efficiency_table, "OccCasNet", lambda config: network)
    with pytest.raises(RuntimeError, match="body of a loop"):
        flops_by_xla(preset("tiny"), (16, 16))


@pytest.mark.parametrize(("size", "repeats"), [(0, 1), (16, 0)])
def test_measurement_without_pixels_or_repeats_is_rejected(size, repeats):
    with pytest.raises(InputError, match="1 or more"):
        measure(small_form(preset("cas_1")), size, repeats=repeats)

"""The arithmetic of the scaling report, and the committed tables."""

from pathlib import Path

import pytest

from experiments import scaling
from experiments.scaling import Link, all_reduce_seconds, communication_seconds, slowest_of


@pytest.mark.parametrize(
    ("devices", "seconds"),
    # Each of n devices sends and receives (n - 1) / n of the array twice.
    [(1, 0.0), (2, 1.0), (4, 1.5), (8, 1.75)],
)
def test_a_ring_sends_each_part_twice(devices, seconds):
    assert all_reduce_seconds(10.0, devices, Link("", 10.0, 0.0)) == seconds


def test_latency_grows_with_the_logarithm_of_the_devices():
    assert all_reduce_seconds(0.0, 8, Link("", 1.0, 1.0)) == 6.0


def test_hosts_exchange_the_part_of_each_device(monkeypatch):
    monkeypatch.setattr(scaling, "NVLINK", Link("", 100.0, 0.0))
    network = Link("", 10.0, 0.0)
    assert communication_seconds(100.0, 4, network, 4) == 1.5
    # Within a host 2 * 3/4 * 100 / 100, between two hosts 2 * 1/2 * 25 / 10.
    assert communication_seconds(100.0, 8, network, 4) == 1.5 + 2.5


def test_the_slowest_of_two_is_later_by_the_spread_over_the_root_of_pi():
    assert slowest_of(1, 0.1) == 1.0
    assert slowest_of(2, 0.1, steps=200_000) == pytest.approx(1.0 + 0.1 / 3.14159**0.5, abs=1e-3)


def test_the_page_has_the_tables_that_the_script_prints(capsys):
    scaling.run()
    page = (Path(__file__).resolve().parents[2] / "docs" / "scaling.md").read_text("utf-8")
    assert capsys.readouterr().out.strip() in page

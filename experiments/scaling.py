"""Time of a training step and throughput of estimates on many devices, by arithmetic.

    python -m experiments.scaling

Cost: seconds on a CPU. It measures nothing on several devices: it starts from the measured times
of one H200 (``docs/performance.md``) and adds communication and waiting by formula. The tables are
committed in ``docs/scaling.md``, with the assumptions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import jax
import numpy as np
import tyro

from experiments.command_line import main
from experiments.markdown import markdown_table
from occjax.models import preset, variable_shapes

DEVICES = (1, 8, 64, 512)


class Link(NamedTuple):
    """A connection of devices.

    Attributes:
        name: Name.
        bytes_per_second: Bytes that a device sends per second.
        latency: Seconds from one device to the next.
    """

    name: str
    bytes_per_second: float
    latency: float


NVLINK = Link("NVLink 4", 450e9, 3e-6)
NETWORKS = (
    Link("InfiniBand NDR, 400 Gbit/s for each device", 50e9, 5e-6),
    Link("Ethernet, 100 Gbit/s for each host of 8 devices", 12.5e9 / 8, 30e-6),
)


@dataclass(frozen=True)
class Assumptions:
    """Numbers that the tables start from.

    Attributes:
        step_seconds: Seconds of a training step of 32 patches of 9x9x32x32 on one device.
        estimate_seconds: Seconds of an estimate of 9x9x512x512 on one device.
        host_devices: Devices of a host, connected by NVLink.
        spread: Standard deviation of a device's step time, relative to its mean.
        scene_bytes: Bytes of the files of a light field, 81 PNG images.
        decode_seconds: Processor seconds to decode a light field.
        storage_bytes_per_second: Bytes per second of the shared storage, for all hosts together.
    """

    step_seconds: float = 0.103
    estimate_seconds: float = 0.211
    host_devices: int = 8
    spread: float = 0.02
    scene_bytes: float = 25e6
    decode_seconds: float = 1.0
    storage_bytes_per_second: float = 10e9


def all_reduce_seconds(size: float, devices: int, link: Link) -> float:
    """Return the seconds of a ring all-reduce, ``2 (n - 1) / n`` times its bytes.

    Args:
        size: Bytes of the reduced array.
        devices: Number of devices ``n``.
        link: Their connection. A message passes ``2 log2(n)`` times its latency, as in a tree.

    Example:
        >>> all_reduce_seconds(1e9, 2, Link("", 1e9, 0.5))
        2.0
    """
    if devices == 1:
        return 0.0
    transfer = 2.0 * (devices - 1) / devices * size / link.bytes_per_second
    return transfer + 2.0 * math.ceil(math.log2(devices)) * link.latency


def communication_seconds(size: float, devices: int, network: Link, host_devices: int) -> float:
    """Return the seconds of an all-reduce within hosts and then between them.

    The devices of a host reduce their parts over NVLink first. Then each device exchanges its part
    of the array with the devices of the same number in the other hosts.

    Args:
        size: Bytes of the reduced array.
        devices: Number of devices.
        network: Connection between hosts.
        host_devices: Devices of a host.
    """
    inside = min(devices, host_devices)
    within = all_reduce_seconds(size, inside, NVLINK)
    return within + all_reduce_seconds(size / inside, devices // inside, network)


def slowest_of(devices: int, spread: float, *, steps: int = 2000) -> float:
    """Return the mean time of the slowest device, relative to the mean of all, by simulation.

    Args:
        devices: Number of devices, each with normally distributed times of mean 1.
        spread: Their standard deviation.
        steps: Number of simulated steps.

    Example:
        >>> round(slowest_of(2, 0.1), 2)  # 1 + 0.1 / sqrt(pi)
        1.06
    """
    if devices == 1:
        return 1.0
    times = np.random.default_rng(0).normal(1.0, spread, (steps, devices))
    return float(times.max(1).mean())


def training_rows(assumed: Assumptions) -> list[list[str]]:
    """Return the table of training steps of 32 patches per device."""
    shapes = variable_shapes(preset("occcasnet"))
    gradient = 4.0 * sum(leaf.size for leaf in jax.tree.leaves(shapes["params"]))
    means = jax.tree.leaves(shapes["batch_stats"])[::2]  # the others are the variances
    rows = []
    for network in NETWORKS:
        for devices in DEVICES if network is NETWORKS[0] else DEVICES[2:]:
            hosts = (devices, network, assumed.host_devices)
            gradients = communication_seconds(gradient, *hosts)
            # Mean and mean square of each channel forwards, their cotangents backwards.
            statistics = sum(2 * communication_seconds(8.0 * mean.size, *hosts) for mean in means)
            waiting = assumed.step_seconds * (slowest_of(devices, assumed.spread) - 1.0)
            step = assumed.step_seconds + gradients + statistics + waiting
            rows.append(
                [
                    str(devices),
                    NVLINK.name if 1 < devices <= assumed.host_devices else network.name,
                    f"{gradient * 2 * (devices - 1) / devices / 1e6:.1f} MB",
                    *(f"{1e3 * part:.1f} ms" for part in (gradients, statistics, waiting, step)),
                    f"{32 * devices / step:,.0f}",
                    f"{100 * assumed.step_seconds / step:.0f} %",
                ]
            )
    rows[0][1] = "none"
    return rows


def estimate_rows(assumed: Assumptions) -> list[list[str]]:
    """Return the table of estimates of a million light fields."""
    rows = []
    for devices in DEVICES:
        compute = 1e6 * assumed.estimate_seconds / devices
        storage = 1e6 * assumed.scene_bytes / assumed.storage_bytes_per_second
        cores = assumed.decode_seconds / assumed.estimate_seconds
        limit = "devices" if compute > storage else "storage"
        rows.append(
            [
                str(devices),
                f"{compute / 3600:.1f} h",
                f"{storage / 3600:.1f} h",
                f"{cores * devices:.0f}",
                f"{max(compute, storage) / 3600:.1f} h, {limit}",
            ]
        )
    return rows


def tables(assumed: Assumptions) -> str:
    """Return both tables."""
    training = markdown_table(
        [
            *("devices", "slowest connection", "sent by a device", "gradients", "BatchNorm"),
            *("waiting", "step", "patches per second", "efficiency"),
        ],
        training_rows(assumed),
        right=True,
    )
    estimates = markdown_table(
        ["devices", "computing", "reading", "cores for decoding", "a million light fields"],
        estimate_rows(assumed),
        right=True,
    )
    return f"{training}\n\n{estimates}"


def run(assumed: tyro.conf.OmitArgPrefixes[Assumptions] = Assumptions()) -> None:
    """Print the time of a step and of a million estimates by number of devices."""
    print(tables(assumed))


if __name__ == "__main__":
    main(run, __doc__)

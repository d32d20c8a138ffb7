"""The command ``weights``."""

from __future__ import annotations

from typing import Annotated, Literal

from tyro.conf import Positional, arg

from occjax.models.bundled import bundled_weights, ready_models
from occjax.models.occcasnet.published_weights import fetch_published_weights
from occjax.models.registry import PRESETS


def weights_command(
    action: Annotated[
        Literal["list", "fetch"],
        Positional,
        arg(
            help="list the weights in the package, the default first, and all models; or fetch "
            "(download) the published OccCasNet weights, which have no licence: for your own use "
            "only.",
        ),
    ],
) -> int:
    """List the weights in the package, or download the published ones."""
    if action == "fetch":
        path = fetch_published_weights()
        print(f"{path}\nuse it with: occjax estimate SCENE -o FOLDER --weights {path}")
        return 0
    for weights in bundled_weights():
        weights.verify()
        size = weights.path.stat().st_size / 1e6
        print(
            f"{weights.name}: {weights.summary}\n"
            f"  {size:.1f} MB, sha256 {weights.sha256[:16]}..., card {weights.card}"
        )
    ready = ready_models()
    bundled = [weights.name for weights in bundled_weights()]
    unlearned = [name for name in ready if name not in bundled]
    others = [name for name in PRESETS if name not in ready]
    print(f"models that have no weights: {', '.join(unlearned)}")
    print(
        "models that need a file of weights ('occjax weights fetch' downloads those of occcasnet, "
        f"'occjax train RUN --network-preset NAME' trains any): {', '.join(others)}"
    )
    return 0

"""The commands ``weights list`` and ``weights fetch``."""

from __future__ import annotations

from occjax.models.bundled import bundled_weights
from occjax.models.fetch import fetch_published_weights


def list_command() -> int:
    """List the weights in the package, the default first."""
    if not bundled_weights():
        print("no weights are in the package; train some with: occjax train")
    for weights in bundled_weights():
        weights.verify()
        size = weights.path.stat().st_size / 1e6
        print(
            f"{weights.name}: {weights.summary}\n"
            f"  {size:.1f} MB, sha256 {weights.sha256[:16]}..., card {weights.card}"
        )
    return 0


def fetch_command() -> int:
    """Download the published OccCasNet weights (no licence: for your own use only)."""
    path = fetch_published_weights()
    print(f"{path}\nuse it with: occjax estimate SCENE -o FOLDER --weights {path}")
    return 0

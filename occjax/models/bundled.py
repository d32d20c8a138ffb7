"""The weights in the package, each with a model card."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from occjax.errors import InputError, nearest
from occjax.models.proposal.config import ProposalNetConfig
from occjax.models.registry import ALIASES, PRESETS

FOLDER = Path(__file__).parent / "weight_files"
"""Folder of ``index.json``, and of ``<name>.safetensors`` and the card ``<name>.md`` per name."""


@dataclass(frozen=True)
class BundledWeights:
    """Weights in the package.

    Attributes:
        name: Name for ``--weights``.
        summary: Purpose, in one line.
        sha256: SHA-256 of the file, in hexadecimal.
    """

    name: str
    summary: str
    sha256: str

    @property
    def path(self) -> Path:
        """File of the weights."""
        return FOLDER / f"{self.name}.safetensors"

    @property
    def card(self) -> Path:
        """Model card: data, command, seed, cost, scores, limits and licence."""
        return FOLDER / f"{self.name}.md"

    def verify(self) -> None:
        """Verify the checksum of the file.

        Raises:
            InputError: If the file is missing or has another content.
        """
        if not self.path.is_file():
            raise InputError(f"{self.path}: is missing; reinstall occjax")
        if hashlib.sha256(self.path.read_bytes()).hexdigest() != self.sha256:
            raise InputError(f"{self.path}: differs from the shipped file; reinstall occjax")


@cache
def bundled_weights() -> tuple[BundledWeights, ...]:
    """Return all weights in the package, the default first.

    Example:
        >>> all(weights.path.suffix == ".safetensors" for weights in bundled_weights())
        True
    """
    entries = json.loads((FOLDER / "index.json").read_text(encoding="utf-8"))
    return tuple(BundledWeights(**entry) for entry in entries)


def is_intact(path: Path) -> bool:
    """Return whether a file is that of weights in the package and has their checksum.

    Args:
        path: An existing file.
    """
    shipped = {weights.sha256 for weights in bundled_weights() if weights.path == path}
    return bool(shipped) and hashlib.sha256(path.read_bytes()).hexdigest() in shipped


def ready_models() -> tuple[str, ...]:
    """Return the names of the models that need no file of weights, the default first.

    Example:
        >>> ready_models()
        ('proposal', 'photometric')
    """
    bundled = [weights.name for weights in bundled_weights()]
    unlearned = [
        name
        for name, config in PRESETS.items()
        if isinstance(config, ProposalNetConfig) and config.selector is None
    ]
    return (*bundled, *unlearned)


def find_weights(name_or_path: str | Path) -> Path:
    """Return the file of weights that are given by a path or by their name in the package.

    Args:
        name_or_path: Path, or a name that ``occjax weights list`` prints, with or without
            ``.safetensors``; former names are accepted.

    Returns:
        Path of the file. A file of that name in the working folder takes precedence.

    Raises:
        InputError: If the file in the package is damaged, or neither the name nor the file exists.
    """
    path = Path(name_or_path)
    named = {weights.name: weights for weights in bundled_weights()}
    name = str(name_or_path).removesuffix(".safetensors")
    name = ALIASES.get(name, name)
    if path.is_file() or (path.suffix and name not in named):
        return path
    if name not in named:
        raise InputError(
            f"{name_or_path}: is neither a file nor the name of weights in the package; "
            f"{nearest(name, named)}"
        )
    weights = named[name]
    weights.verify()
    return weights.path

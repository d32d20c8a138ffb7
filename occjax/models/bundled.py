"""The weights that come with the package, each with a card that says what it is."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from occjax.errors import InputError

FOLDER = Path(__file__).parent / "weight_files"
"""``index.json``, and for each name a ``<name>.safetensors`` and its card ``<name>.md``."""


@dataclass(frozen=True)
class BundledWeights:
    """Weights in the package.

    Attributes:
        name: What ``--weights`` calls them.
        summary: One line on what they are for.
        sha256: Of the file, in hexadecimal.
    """

    name: str
    summary: str
    sha256: str

    @property
    def path(self) -> Path:
        """The file of the weights."""
        return FOLDER / f"{self.name}.safetensors"

    @property
    def card(self) -> Path:
        """The file that tells data, command, seed, cost, scores, limits and licence."""
        return FOLDER / f"{self.name}.md"

    def verify(self) -> None:
        """Compare the file with its checksum.

        Raises:
            InputError: If it is missing or another one.
        """
        if not self.path.is_file():
            raise InputError(f"{self.path}: is missing; install occjax again")
        if hashlib.sha256(self.path.read_bytes()).hexdigest() != self.sha256:
            raise InputError(f"{self.path}: is not the file that was shipped; install occjax again")


@cache
def bundled_weights() -> tuple[BundledWeights, ...]:
    """All weights in the package, the default first.

    Example:
        >>> all(weights.path.suffix == ".safetensors" for weights in bundled_weights())
        True
    """
    entries = json.loads((FOLDER / "index.json").read_text(encoding="utf-8"))
    return tuple(BundledWeights(**entry) for entry in entries)


def find_weights(name_or_path: str | Path) -> Path:
    """The file of weights given as a path, or by the name of those in the package.

    Args:
        name_or_path: A path, or a name as ``occjax weights list`` shows it, with or without the
            ``.safetensors`` by which an estimate calls it.

    Returns:
        The file. A file of that very name in the working folder comes first.

    Raises:
        InputError: If the file in the package is damaged, or there is neither name nor file.
    """
    path = Path(name_or_path)
    named = {weights.name: weights for weights in bundled_weights()}
    name = str(name_or_path).removesuffix(".safetensors")
    if path.is_file() or (path.suffix and name not in named):
        return path
    if name not in named:
        raise InputError(
            f"{name_or_path}: there is no such file, and no weights of this name in the package; "
            f"there are {', '.join(named) or 'none'}"
        )
    weights = named[name]
    weights.verify()
    return weights.path

"""Submissions to the HCI 4D benchmark: a zip file of disparity maps and runtimes.

For each of the benchmark's twelve scenes it contains ``disp_maps/<scene>.pfm``, the 512x512
disparities of the centre view, and ``runtimes/<scene>.txt``, the runtime in seconds.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Callable, Mapping, Sequence
from io import BufferedReader
from pathlib import Path

import numpy as np

from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.io.files import decoder_errors, decoding
from occjax.io.pfm import decode_pfm, encode_pfm, pfm_header

STRATIFIED = ("backgammon", "dots", "pyramids", "stripes")
"""Synthetic test patterns of the benchmark."""

TRAINING = ("boxes", "cotton", "dino", "sideboard")
"""Photorealistic scenes with public ground truth."""

TEST = ("bedroom", "bicycle", "herbs", "origami")
"""Photorealistic scenes without public ground truth."""

SCENES = (*STRATIFIED, *TRAINING, *TEST)
"""The twelve scenes of the benchmark, in the order of its tables."""

SIZE = (512, 512)
"""Rows and columns of the benchmark's views."""

MAPS, RUNTIMES = "disp_maps", "runtimes"

MAX_ENTRY_BYTES = 2**24
"""Size of an entry above which it is not unpacked, in bytes; a map has one million."""


def map_name(scene: str) -> str:
    """Return the path of a scene's disparity map in a submission.

    Example:
        >>> map_name("cotton")
        'disp_maps/cotton.pfm'
    """
    return f"{MAPS}/{scene}.pfm"


def runtime_name(scene: str) -> str:
    """Return the path of a scene's runtime in a submission.

    Example:
        >>> runtime_name("cotton")
        'runtimes/cotton.txt'
    """
    return f"{RUNTIMES}/{scene}.txt"


def write_submission(
    path: str | Path, disparities: Mapping[str, np.ndarray], seconds: Mapping[str, float]
) -> None:
    """Write a submission atomically; equal content gives equal bytes.

    Args:
        path: Zip file; an existing file is replaced.
        disparities: ``[H, W]`` disparity of the centre view by scene, pixels per view step.
        seconds: Runtime by scene.

    Raises:
        InputError: If maps and runtimes are of different scenes, a map does not have two
            dimensions, or the file cannot be written.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "submission.zip"
        >>> write_submission(path, {"cotton": np.zeros((512, 512))}, {"cotton": 7.9})
        >>> check_submission(path, scenes=("cotton",))
        ()
    """
    if set(disparities) != set(seconds):
        odd = ", ".join(sorted(set(disparities) ^ set(seconds)))
        raise InputError(
            f"{path}: lacks the map or the runtime of {odd}; pass both for every scene"
        )
    entries = {
        name: content
        for scene in sorted(disparities)
        for name, content in (
            (map_name(scene), encode_pfm(disparities[scene], map_name(scene))),
            (runtime_name(scene), f"{seconds[scene]:.6g}\n".encode("ascii")),
        )
    }
    with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name in sorted(entries):
            # A ZipInfo has no time of writing.
            archive.writestr(zipfile.ZipInfo(name), entries[name], zipfile.ZIP_DEFLATED)


def check_submission(
    path: str | Path, *, scenes: Sequence[str] = SCENES, size: tuple[int, int] = SIZE
) -> tuple[str, ...]:
    """Return all faults of a submission.

    Maps must be PFM files with one channel of finite little-endian values, and runtimes positive
    numbers.

    Args:
        path: The zip file.
        scenes: Scenes that it must contain, and no others.
        size: ``(H, W)`` of the maps, in pixels.

    Returns:
        One sentence for each fault, starting with the name of the entry; empty without faults.

    Raises:
        InputError: If the file cannot be read.
    """
    path = Path(path)
    with decoding(path, "a submission") as file:
        return _archive_findings(file, path.name, scenes, size)


def _archive_findings(
    file: BufferedReader, name: str, scenes: Sequence[str], size: tuple[int, int]
) -> tuple[str, ...]:
    """Return the faults of an open archive."""
    try:
        with decoder_errors(name, "a zip archive", remedy="make it again"):
            archive = zipfile.ZipFile(file)
    except InputError as error:
        return (str(error),)
    with archive:
        entries = [entry for entry in archive.infolist() if not _is_expected_folder(entry)]
        names = [entry.filename for entry in entries]
        expected: dict[str, Callable[[bytes, str], list[str]]] = {}
        for scene in scenes:
            expected[map_name(scene)] = lambda data, name: _map_findings(data, name, size)
            expected[runtime_name(scene)] = _runtime_findings
        folder = _folder_around(names, expected)
        if folder is not None:
            return (
                f"{folder}/: contains all entries; zip the content of this folder, not the folder",
            )
        strays = [name for name in names if name not in expected]
        findings = [f"{_shown(name)}: does not belong in a submission" for name in strays]
        for name, check in expected.items():
            found = [entry for entry in entries if entry.filename == name]
            if not found:
                findings.append(f"{name}: is missing")
            elif len(found) > 1:
                findings.append(f"{name}: occurs {len(found)} times")
            else:
                findings += _entry_findings(archive, found[0], check)
    return tuple(findings)


def _is_expected_folder(entry: zipfile.ZipInfo) -> bool:
    """Return whether an entry is one of the two folders, which some archivers list."""
    return entry.filename in (f"{MAPS}/", f"{RUNTIMES}/")


def _folder_around(names: Sequence[str], expected: Mapping[str, object]) -> str | None:
    """Return the folder that contains all entries, if it was zipped instead of its content."""
    tops = {name.partition("/")[0] for name in names}
    inner = {name.partition("/")[2] for name in names}
    return tops.pop() if len(tops) == 1 and inner & set(expected) else None


def _shown(name: str) -> str:
    """Return the name of an entry on one line."""
    return name if name.isprintable() else ascii(name)


def _entry_findings(
    archive: zipfile.ZipFile, entry: zipfile.ZipInfo, check: Callable[[bytes, str], list[str]]
) -> list[str]:
    """Return the faults of an entry with an expected name."""
    name = entry.filename
    if entry.file_size > MAX_ENTRY_BYTES:
        return [f"{name}: has {entry.file_size} bytes, far too many"]
    if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        return [f"{name}: is compressed by an unusual method; use deflate"]
    try:
        what, remedy = "an entry of a zip archive", "make the archive again"
        with decoder_errors(name, what, remedy=remedy), archive.open(entry) as stream:
            data = stream.read(entry.file_size)  # at most, since the archive may lie about it
    except InputError as error:
        return [str(error)]
    return check(data, name)


def _map_findings(data: bytes, name: str, size: tuple[int, int]) -> list[str]:
    """Return the faults of a disparity map."""
    try:
        header = pfm_header(data, name)
    except InputError as error:
        return [str(error)]
    findings = []
    found = (header.height, header.width)
    if found != tuple(size):
        findings.append(f"{name}: has {found[0]}x{found[1]} pixels, not {size[0]}x{size[1]}")
    if header.channels != 1:
        findings.append(f"{name}: has {header.channels} channels, not one")
    if not header.little_endian:
        findings.append(f"{name}: is big-endian (its scale is positive), not little-endian")
    missing = int(np.sum(~np.isfinite(decode_pfm(data, name))))
    if missing:
        findings.append(f"{name}: {missing} values are not finite")
    return findings


def _runtime_findings(data: bytes, name: str) -> list[str]:
    """Return the faults of a runtime."""
    text = data.decode("ascii", errors="replace").strip()
    try:
        # Only Python accepts 1_000 as a number.
        seconds = math.nan if "_" in text else float(text)
    except ValueError:
        seconds = math.nan
    if math.isfinite(seconds) and seconds > 0.0:
        return []
    return [f"{name}: reads {text[:20]!r}, not a positive number of seconds"]

"""Submissions to the HCI 4D benchmark: one zip of disparity maps and runtimes.

For each of the benchmark's twelve scenes it holds ``disp_maps/<scene>.pfm``, 512x512 disparities of
the centre view, and ``runtimes/<scene>.txt``, the seconds that they took, and nothing else.
"""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.io.files import reading
from occjax.io.pfm import decode_pfm, encode_pfm, pfm_header

STRATIFIED = ("backgammon", "dots", "pyramids", "stripes")
"""Scenes of the benchmark that are made to test one thing each."""

TRAINING = ("boxes", "cotton", "dino", "sideboard")
"""Photorealistic scenes whose ground truth is public."""

TEST = ("bedroom", "bicycle", "herbs", "origami")
"""Photorealistic scenes whose ground truth the benchmark keeps to itself."""

SCENES = (*STRATIFIED, *TRAINING, *TEST)
"""The twelve scenes of the benchmark, in the order of its tables."""

SIZE = (512, 512)
"""Rows and columns of the benchmark's views."""

MAPS, RUNTIMES = "disp_maps", "runtimes"

_LARGEST = 2**24
"""Bytes of an entry beyond which it is not unpacked: a map has one million."""


def map_name(scene: str) -> str:
    """Where a submission has the disparity map of a scene.

    Example:
        >>> map_name("cotton")
        'disp_maps/cotton.pfm'
    """
    return f"{MAPS}/{scene}.pfm"


def runtime_name(scene: str) -> str:
    """Where a submission has the runtime of a scene.

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
        path: Zip file to write; one that is there is replaced.
        disparities: By scene, ``[H, W]`` disparity of the centre view, pixels per view step.
        seconds: By scene, the time it took.

    Raises:
        InputError: If the two are not of the same scenes, a map is none, or nothing can be written.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "submission.zip"
        >>> write_submission(path, {"cotton": np.zeros((512, 512))}, {"cotton": 7.9})
        >>> check_submission(path, scenes=("cotton",))
        ()
    """
    if set(disparities) != set(seconds):
        odd = ", ".join(sorted(set(disparities) ^ set(seconds)))
        raise InputError(f"{path}: map or runtime is missing of {odd}; pass both of every scene")
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
            # Without the time of writing.
            archive.writestr(zipfile.ZipInfo(name), entries[name], zipfile.ZIP_DEFLATED)


def check_submission(
    path: str | Path, *, scenes: Sequence[str] = SCENES, size: tuple[int, int] = SIZE
) -> tuple[str, ...]:
    """Everything that is wrong with a submission, whoever made it.

    Maps must be PFM files with one channel of finite little-endian values, runtimes positive
    numbers. The values themselves are not judged.

    Args:
        path: The zip file.
        scenes: Which scenes it must have, and no others.
        size: ``(H, W)`` of the maps, in pixels.

    Returns:
        A sentence for each finding, with the name of the entry; none if all is well.

    Raises:
        InputError: If the file cannot be read at all.
    """
    path = Path(path)
    with reading(path):
        path.open("rb").close()
    try:
        archive = zipfile.ZipFile(path)
    except (zipfile.BadZipFile, NotImplementedError, ValueError) as error:
        return (f"{path.name}: is no zip archive, or a damaged one ({error})",)
    with archive:
        entries = [entry for entry in archive.infolist() if not _is_expected_folder(entry)]
        names = [entry.filename for entry in entries]
        expected: dict[str, Callable[[bytes, str], list[str]]] = {}
        for scene in scenes:
            expected[map_name(scene)] = lambda data, name: _map_findings(data, name, size)
            expected[runtime_name(scene)] = _runtime_findings
        folder = _folder_around(names, expected)
        if folder is not None:
            return (f"{folder}/: everything lies in it; zip what is in that folder, not itself",)
        strays = [name for name in names if name not in expected]
        findings = [f"{_shown(name)}: does not belong in a submission" for name in strays]
        for name, check in expected.items():
            found = [entry for entry in entries if entry.filename == name]
            if not found:
                findings.append(f"{name}: is missing")
            elif len(found) > 1:
                findings.append(f"{name}: is there {len(found)} times")
            else:
                findings += _entry_findings(archive, found[0], check)
    return tuple(findings)


def _is_expected_folder(entry: zipfile.ZipInfo) -> bool:
    """Archivers list folders, too, or do not."""
    return entry.is_dir() and entry.filename in (f"{MAPS}/", f"{RUNTIMES}/")


def _folder_around(names: Sequence[str], expected: Mapping[str, object]) -> str | None:
    """The folder that was zipped in place of what is in it."""
    tops = {name.partition("/")[0] for name in names}
    inner = {name.partition("/")[2] for name in names}
    return tops.pop() if len(tops) == 1 and inner & set(expected) else None


def _shown(name: str) -> str:
    """The name of an entry in one line, whatever is in it."""
    return name if name.isprintable() else ascii(name)


def _entry_findings(
    archive: zipfile.ZipFile, entry: zipfile.ZipInfo, check: Callable[[bytes, str], list[str]]
) -> list[str]:
    """Findings about one entry of the right name."""
    name = entry.filename
    if entry.file_size > _LARGEST:
        return [f"{name}: has {entry.file_size} bytes, many times more than it can have"]
    if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        return [f"{name}: is packed by an unusual method; use deflate"]
    try:
        data = archive.read(entry)
    except RuntimeError:
        return [f"{name}: is encrypted"]
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, ValueError) as error:
        return [f"{name}: is damaged ({error})"]
    return check(data, name)


def _map_findings(data: bytes, name: str, size: tuple[int, int]) -> list[str]:
    """Findings about the content of a disparity map."""
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
    """Findings about the content of a runtime."""
    text = data.decode("ascii", errors="replace").strip()
    try:
        # Python would take 1_000 for a number; others do not.
        seconds = math.nan if "_" in text else float(text)
    except ValueError:
        seconds = math.nan
    if math.isfinite(seconds) and seconds > 0.0:
        return []
    return [f"{name}: reads {text[:20]!r}, not a positive number of seconds"]

"""Downloading the weights that the authors of the paper published.

They lie in a repository without a licence, so this project neither contains nor passes them on:
each user downloads them from their authors. The file is verified by its git blob id, the name under
which the authors' own repository knows its content.
"""

from __future__ import annotations

import hashlib
import sys
import urllib.error
import urllib.request
from collections.abc import Generator
from contextlib import closing
from http.client import HTTPException, IncompleteRead
from pathlib import Path

import platformdirs
from tqdm import tqdm

from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.io.files import reading

PUBLISHED_URL = (
    "https://raw.githubusercontent.com/chaowentao/OccCasNet/"
    "dc6c96d1bc0eb5bafacd3e87a92f96d3c8ea9eff/CasLF_checkpoint/"
    "CasLF_s1_0.25_s2_0.125_9_sample_backward_mask_scratch_lr_ckp/"
    "iter0116_s2_valmse0.762_bp1.733.hdf5"
)
"""Where the authors published their weights."""

PUBLISHED_BLOB_ID = "e158717ba6f40e9c510b9025c74a08ad946f94e9"
"""Git blob id of that file."""

LICENCE_NOTICE = (
    "The published weights come from github.com/chaowentao/OccCasNet, which has no licence: all "
    "rights are with its authors. Do not redistribute the file."
)

FILE_NAME = "occcasnet_published.hdf5"
TIMEOUT_SECONDS = 30.0
CHUNK_BYTES = 2**16


def fetch_published_weights(
    *,
    cache: Path | str | None = None,
    url: str | None = None,
    blob_id: str = PUBLISHED_BLOB_ID,
    progress: bool = True,
) -> Path:
    """Download the published weights, unless the cache already has them.

    The file appears in the cache complete and verified, or not at all. A cached file whose content
    has changed is downloaded anew.

    Args:
        cache: Folder to keep the file in; None is the user's cache folder.
        url: Where to download from; None is :data:`PUBLISHED_URL`.
        blob_id: Git blob id that the file must have.
        progress: Show the licence notice and a progress bar on standard error.

    Returns:
        The verified file, which ``occjax.models`` reads as weights in the published layout.

    Raises:
        InputError: If the download fails, another file arrives, or the cache cannot be written.
    """
    path = (Path(cache) if cache is not None else default_cache()) / FILE_NAME
    url = url or PUBLISHED_URL
    if progress:
        print(LICENCE_NOTICE, file=sys.stderr)
    with reading(path):
        cached = path.is_file()
    if cached and git_blob_id(path) == blob_id:
        return path
    with atomic_path(path) as temporary:
        _download(url, temporary, progress)
        found = git_blob_id(temporary)
        if found != blob_id:
            raise InputError(
                f"{url}: delivered another file (git blob id {found}, expected {blob_id}); "
                "nothing was kept, try again or from another network"
            )
    return path


def default_cache() -> Path:
    """Folder of downloaded weights in the user's cache."""
    return Path(platformdirs.user_cache_dir("occjax")) / "weights"


def git_blob_id(path: Path | str) -> str:
    """Name that git gives to the content of a file: SHA-1 of ``blob SIZE``, a zero byte, the bytes.

    Args:
        path: Any file.

    Returns:
        Forty hexadecimal digits, as ``git hash-object`` prints them.

    Raises:
        InputError: If the file cannot be read.

    Example:
        >>> import tempfile
        >>> path = Path(tempfile.mkdtemp()) / "empty"
        >>> path.touch()
        >>> git_blob_id(path)
        'e69de29bb2d1d6434b8b29ae775ad8c2e48c5391'
    """
    path = Path(path)
    with reading(path), path.open("rb") as file:
        header = f"blob {path.stat().st_size}\0".encode()
        return hashlib.file_digest(
            file, lambda: hashlib.sha1(header, usedforsecurity=False)
        ).hexdigest()


def _download(url: str, target: Path, progress: bool) -> None:
    """Write what ``url`` delivers to ``target``."""
    bar = tqdm(unit="B", unit_scale=True, desc=FILE_NAME, disable=not progress)
    with closing(_body(url)) as body, target.open("wb") as file, bar:
        for chunk, length in body:
            file.write(chunk)
            bar.total = length
            bar.update(len(chunk))


def _body(url: str) -> Generator[tuple[bytes, int | None], None, None]:
    """Pieces of what ``url`` delivers, each with the announced length of the whole.

    A generator, so that only errors of the network pass through its ``except``, not those of the
    disk to which the caller writes.
    """
    received, length = 0, None
    try:
        with urllib.request.urlopen(url, timeout=TIMEOUT_SECONDS) as response:
            announced = response.headers["Content-Length"]
            length = None if announced is None else int(announced)
            while chunk := response.read(CHUNK_BYTES):
                received += len(chunk)
                yield chunk, length
    except urllib.error.HTTPError as error:
        error.close()  # the error is also the response, which holds the connection
        raise InputError(
            f"{url}: the server answers {error.code} ({error.reason}); try again later"
        ) from error
    except IncompleteRead as error:
        received += len(error.partial)
    except (OSError, HTTPException, ValueError) as error:
        reason = " ".join(str(getattr(error, "reason", error)).split())
        raise InputError(
            f"{url}: cannot be downloaded ({reason}); check network and proxy, then try again"
        ) from error
    # Where IncompleteRead is not raised, a connection that closes early looks like the end.
    if length is not None and received < length:
        raise InputError(
            f"{url}: the download broke off after {received} of {length} bytes; try again"
        )

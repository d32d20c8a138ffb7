"""Download of the weights that the authors of the paper published.

Their repository has no licence, so this project does not contain or redistribute the weights. Each
user downloads them from the authors. The git blob id, which the authors' repository uses for the
file, verifies the download.
"""

from __future__ import annotations

import hashlib
import sys
import urllib.error
import urllib.request
from http.client import HTTPException
from pathlib import Path

import platformdirs
from tqdm import tqdm

from occjax.errors import InputError
from occjax.io.atomic import atomic_path
from occjax.io.files import read_errors

PUBLISHED_URL = (
    "https://raw.githubusercontent.com/chaowentao/OccCasNet/"
    "dc6c96d1bc0eb5bafacd3e87a92f96d3c8ea9eff/CasLF_checkpoint/"
    "CasLF_s1_0.25_s2_0.125_9_sample_backward_mask_scratch_lr_ckp/"
    "iter0116_s2_valmse0.762_bp1.733.hdf5"
)
"""URL of the published weights."""

PUBLISHED_BLOB_ID = "e158717ba6f40e9c510b9025c74a08ad946f94e9"
"""Git blob id of the file at PUBLISHED_URL."""

LICENCE_NOTICE = (
    "The published weights come from github.com/chaowentao/OccCasNet, which has no licence: all "
    "rights are with its authors. Do not redistribute the file."
)

FILE_NAME = "occcasnet_published.hdf5"
TIMEOUT_SECONDS = 30.0


def fetch_published_weights(
    *,
    cache: Path | str | None = None,
    url: str | None = None,
    blob_id: str = PUBLISHED_BLOB_ID,
    progress: bool = True,
) -> Path:
    """Download the published weights, unless the cache already holds them.

    The file appears in the cache complete and verified, or not at all. If the content of a cached
    file has changed, the file is downloaded again.

    Args:
        cache: Folder of the file; None for the user's cache folder.
        url: Address of the file; None for :data:`PUBLISHED_URL`.
        blob_id: Git blob id that the file must have.
        progress: Whether to print the licence notice and a progress bar on standard error.

    Returns:
        Path of the verified file, for :func:`occjax.models.load_weights`.

    Raises:
        InputError: If the download fails, another file arrives, or the cache cannot be written.
    """
    folder = Path(platformdirs.user_cache_dir("occjax")) / "weights" if cache is None else cache
    path = Path(folder) / FILE_NAME
    url = url or PUBLISHED_URL
    if progress:
        print(LICENCE_NOTICE, file=sys.stderr)
    with read_errors(path):
        if path.is_file() and git_blob_id(path.read_bytes()) == blob_id:
            return path
    with atomic_path(path) as temporary:
        content = _download(url, progress)
        found = git_blob_id(content)
        if found != blob_id:
            raise InputError(
                f"{url}: the downloaded file is not the published one (git blob id {found}, "
                f"expected {blob_id}); try again or from another network"
            )
        temporary.write_bytes(content)
    return path


def git_blob_id(content: bytes) -> str:
    """Return the git blob id of a file's content: SHA-1 of ``blob SIZE``, a zero byte, the content.

    Returns:
        40 hexadecimal digits, as ``git hash-object`` prints them.

    Example:
        >>> git_blob_id(b"")
        'e69de29bb2d1d6434b8b29ae775ad8c2e48c5391'
    """
    header = f"blob {len(content)}\0".encode()
    return hashlib.sha1(header + content, usedforsecurity=False).hexdigest()


def _download(url: str, progress: bool) -> bytes:
    """Return the content of a URL."""
    content = bytearray()
    try:
        with urllib.request.urlopen(url, timeout=TIMEOUT_SECONDS) as response:
            length = int(response.headers["Content-Length"] or 0)
            unit = {"unit": "B", "unit_scale": True}
            with tqdm(total=length, desc=FILE_NAME, disable=not progress, **unit) as bar:
                while chunk := response.read(2**16):
                    content += chunk
                    bar.update(len(chunk))
    except urllib.error.HTTPError as error:
        error.close()  # the error object holds the connection
        raise InputError(
            f"{url}: the server answers {error.code} ({error.reason}); try again later"
        ) from error
    except (OSError, HTTPException, ValueError) as error:
        reason = " ".join(str(getattr(error, "reason", error)).split())
        raise InputError(
            f"{url}: cannot be downloaded ({reason}); check network and proxy, then try again"
        ) from error
    # A connection that closes early looks like the end of the file.
    if len(content) < length:
        raise InputError(
            f"{url}: the download stopped after {len(content)} of {length} bytes; try again"
        )
    return bytes(content)

"""PNG files without metadata."""

from __future__ import annotations

SIGNATURE_LENGTH = 8
ESSENTIAL = (b"IHDR", b"PLTE", b"IDAT", b"IEND")


def essential_chunks(png: bytes) -> bytes:
    """Return a PNG file without metadata, so that equal pixels give equal files.

    Blender stores the rendering time in its files.

    Args:
        png: Bytes of a PNG file.

    Returns:
        Bytes of the file with only the chunks that define the pixels.
    """
    kept, start = [png[:SIGNATURE_LENGTH]], SIGNATURE_LENGTH
    while start < len(png):
        # A chunk is: length of the data, four-letter type, data, checksum.
        end = start + 12 + int.from_bytes(png[start : start + 4], "big")
        if png[start + 4 : start + 8] in ESSENTIAL:
            kept.append(png[start:end])
        start = end
    return b"".join(kept)

"""PNG files without the notes that Blender writes into them."""

from __future__ import annotations

SIGNATURE_LENGTH = 8
ESSENTIAL = (b"IHDR", b"PLTE", b"IDAT", b"IEND")


def essential_chunks(png: bytes) -> bytes:
    """The picture alone: notes tell how long it took, and the same picture shall be the same file.

    Args:
        png: The bytes of a PNG file.

    Returns:
        Those of the file with the chunks that make the pixels.
    """
    kept, start = [png[:SIGNATURE_LENGTH]], SIGNATURE_LENGTH
    while start < len(png):
        # Length of the data, four letters, the data, a check sum.
        end = start + 12 + int.from_bytes(png[start : start + 4], "big")
        if png[start + 4 : start + 8] in ESSENTIAL:
            kept.append(png[start:end])
        start = end
    return b"".join(kept)

"""Format of written submissions, and detection of every fault."""

import struct
import zipfile

import numpy as np
import pytest

from experiments.submission import SCENES, check_submission, write_submission
from occjax.errors import InputError


def pfm(values, *, magic=b"Pf", scale=b"-1.0", order="<"):
    """Return a PFM file by the format's definition; ``values`` are in file order, bottom up."""
    height, width = values.shape[:2]
    header = magic + b"\n%d %d\n" % (width, height) + scale + b"\n"
    return header + struct.pack(f"{order}{values.size}f", *values.ravel())


def content(**changes):
    """Return the entries of a small valid submission of two scenes, with changes."""
    values = np.arange(12.0).reshape(3, 4)
    entries = {
        "disp_maps/dots.pfm": pfm(values),
        "disp_maps/dino.pfm": pfm(values),
        "runtimes/dots.txt": b"1.5\n",
        "runtimes/dino.txt": b"12",
    }
    return {name: data for name, data in (entries | changes).items() if data is not None}


def zipped(path, entries, **options):
    with zipfile.ZipFile(path, "w", **options) as archive:
        for name, data in entries.items():
            archive.writestr(name, data)
    return path


def check(path):
    return check_submission(path, scenes=("dots", "dino"), size=(3, 4))


def test_written_submission_has_the_format_of_the_benchmark(tmp_path):
    maps = {scene: np.full((512, 512), n, np.float32) for n, scene in enumerate(SCENES)}
    maps["dots"] = np.arange(512 * 512, dtype=np.float64).reshape(512, 512)
    write_submission(tmp_path / "one.zip", maps, dict.fromkeys(SCENES, 1 / 3))
    assert check_submission(tmp_path / "one.zip") == ()
    with zipfile.ZipFile(tmp_path / "one.zip") as archive:
        assert len(archive.namelist()) == 24
        header, values = archive.read("disp_maps/dots.pfm").split(b"-1.0\n", 1)
        assert float(archive.read("runtimes/herbs.txt")) == pytest.approx(1 / 3, rel=1e-5)
    assert header == b"Pf\n512 512\n"
    # The bottom row comes first.
    assert struct.unpack("<512f", values[: 4 * 512]) == tuple(range(511 * 512, 512 * 512))
    write_submission(tmp_path / "two.zip", maps, dict.fromkeys(SCENES, 1 / 3))
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "two.zip").read_bytes()


def test_maps_without_runtimes_are_rejected(tmp_path):
    with pytest.raises(InputError, match=r"lacks the map or the runtime of dino, dots"):
        write_submission(tmp_path / "one.zip", {"dots": np.zeros((2, 2))}, {"dino": 1.0})
    with pytest.raises(InputError, match=r"dots\.pfm: .*not \[2\]"):
        write_submission(tmp_path / "one.zip", {"dots": np.zeros(2)}, {"dots": 1.0})
    assert list(tmp_path.iterdir()) == []


def test_valid_submission_of_another_archiver_has_no_faults(tmp_path):
    entries = {"disp_maps/": b"", "runtimes/": b""} | content()
    entries["runtimes/dots.txt"] = b" 3e-2\r\n"
    assert check(zipped(tmp_path / "one.zip", entries)) == ()


NAN, INFINITE = np.full((3, 4), np.nan), np.array([[np.inf, 1.0, -np.inf, 0.0]] * 3)
FAULTS = {
    "disp_maps/dots.pfm": [
        (None, "is missing"),
        (b"", "not a PFM file"),
        (pfm(np.zeros((4, 3))), "has 4x3 pixels, not 3x4"),
        (pfm(np.zeros((3, 4, 3)), magic=b"PF"), "has 3 channels, not one"),
        (pfm(np.zeros((3, 4)), scale=b"1.0", order=">"), "is big-endian"),
        (pfm(NAN), "12 values are not finite"),
        (pfm(INFINITE), "6 values are not finite"),
        (pfm(np.zeros((3, 4)))[:-1], "truncated"),
        (pfm(np.zeros((3, 4))) + b"\n", "damaged"),
    ],
    "runtimes/dots.txt": [
        (None, "is missing"),
        (b"", "reads '', not a positive"),
        (b"0", "reads '0', not a positive"),
        (b"-1.5", "not a positive"),
        (b"nan", "not a positive"),
        (b"inf", "not a positive"),
        (b"1_000", "not a positive"),
        (b"1.5 s", "not a positive"),
        (b"1,5", "not a positive"),
        ("\uff11".encode(), "not a positive"),
        (b"\xff\xfe1\x00", "not a positive"),
    ],
    "notes.txt": [(b"", "does not belong")],
    "disp_maps/cotton.pfm": [(pfm(np.zeros((3, 4))), "does not belong")],
    "Runtimes/dots.txt": [(b"1", "does not belong")],
    "disp_maps/old/": [(b"", "does not belong")],
}


@pytest.mark.parametrize(
    ("name", "data", "says"),
    [(name, data, says) for name, cases in FAULTS.items() for data, says in cases],
)
def test_each_fault_is_one_line_that_names_the_entry(tmp_path, name, data, says):
    findings = check(zipped(tmp_path / "one.zip", content(**{name: data})))
    assert len(findings) == 1
    assert findings[0].startswith(f"{name}: ")
    assert says in findings[0]
    assert "\n" not in findings[0]


def test_all_faults_are_reported(tmp_path):
    entries = content(**{"disp_maps/dots.pfm": pfm(NAN.T, scale=b"1", order=">")}) | {"a\nb": b""}
    del entries["runtimes/dino.txt"]
    assert check(zipped(tmp_path / "one.zip", entries)) == (
        r"'a\nb': does not belong in a submission",
        "disp_maps/dots.pfm: has 4x3 pixels, not 3x4",
        "disp_maps/dots.pfm: is big-endian (its scale is positive), not little-endian",
        "disp_maps/dots.pfm: 12 values are not finite",
        "runtimes/dino.txt: is missing",
    )


def test_folder_around_all_entries_is_one_fault(tmp_path):
    entries = {f"mine/{name}": data for name, data in content().items()}
    (finding,) = check(zipped(tmp_path / "one.zip", entries))
    assert finding.startswith("mine/: contains all entries")


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_repeated_entry_is_a_fault(tmp_path):
    path = zipped(tmp_path / "one.zip", content())
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("runtimes/dots.txt", b"2")
    assert check(path) == ("runtimes/dots.txt: occurs 2 times",)


def test_damaged_archive_is_a_fault(tmp_path):
    path = tmp_path / "one.zip"
    path.write_bytes(b"no zip at all")
    assert "cannot be decoded as a zip archive" in check(path)[0]
    whole = zipped(tmp_path / "whole.zip", content()).read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert "cannot be decoded as a zip archive" in check(path)[0]
    path.write_bytes(whole.replace(b"1.5\n", b"2.5\n"))
    (finding,) = check(path)
    assert finding.startswith("runtimes/dots.txt: cannot be decoded")


def test_damage_of_any_byte_raises_no_other_error(tmp_path):
    whole = zipped(tmp_path / "whole.zip", content(), compression=zipfile.ZIP_DEFLATED).read_bytes()
    path = tmp_path / "one.zip"
    found = 0
    for place in range(0, len(whole), 3):
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        path.write_bytes(damaged)
        found += bool(check(path))
    # Damage of times and attributes is harmless.
    assert found > 0.6 * len(range(0, len(whole), 3))


def test_entry_of_a_hundred_megabytes_is_not_unpacked(tmp_path):
    entries = content(**{"runtimes/dots.txt": b"1" * 10**8})
    path = zipped(tmp_path / "one.zip", entries, compression=zipfile.ZIP_DEFLATED)
    (finding,) = check(path)
    assert finding.startswith("runtimes/dots.txt: has 100000000 bytes")


def test_unusual_compression_is_a_fault(tmp_path):
    path = zipped(tmp_path / "one.zip", content(), compression=zipfile.ZIP_BZIP2)
    assert [finding.split(": ")[1] for finding in check(path)] == [
        "is compressed by an unusual method; use deflate"
    ] * 4


def test_unreadable_file_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        check_submission(tmp_path / "one.zip")
    with pytest.raises(InputError, match="is a folder"):
        check_submission(tmp_path)

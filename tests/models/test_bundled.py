"""Weights in the package: their checksums, their cards, and how they are found."""

import hashlib
import json
import shutil

import pytest

from occjax.errors import InputError
from occjax.models import bundled
from occjax.models.weights import load_weights


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package with one file of weights."""
    (tmp_path / "good.safetensors").write_bytes(b"weights")
    digest = hashlib.sha256(b"weights").hexdigest()
    entry = {"name": "good", "summary": "for tests", "sha256": digest}
    (tmp_path / "index.json").write_text(json.dumps([entry]))
    monkeypatch.setattr(bundled, "FOLDER", tmp_path)
    bundled.bundled_weights.cache_clear()
    yield tmp_path
    bundled.bundled_weights.cache_clear()


def test_shipped_weights_are_complete_described_and_readable(tmp_path):
    names = set()
    for weights in bundled.bundled_weights():
        weights.verify()
        assert "licence" in weights.card.read_text(encoding="utf-8").lower()
        load_weights(weights.path)
        # The shapes of intact files are not checked again when they are read; those of a copy are.
        load_weights(shutil.copy(weights.path, tmp_path))
        names.add(weights.name)
    files = {file.stem for file in bundled.FOLDER.glob("*.safetensors")}
    assert files == names
    assert sum(file.stat().st_size for file in bundled.FOLDER.iterdir()) <= 12e6
    assert bundled.find_weights("light") == bundled.find_weights("proposal")  # a former name


def test_weights_are_found_by_name_unless_the_file_exists(package, tmp_path, monkeypatch):
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    for name in ("good", "good.safetensors"):
        assert bundled.find_weights(name) == package / "good.safetensors"
    (tmp_path / "work" / "good.safetensors").write_bytes(b"own")
    own = bundled.find_weights("good.safetensors")
    assert own.resolve() == tmp_path / "work" / "good.safetensors"
    assert bundled.find_weights(tmp_path / "own.safetensors") == tmp_path / "own.safetensors"


def test_unknown_name_is_refused_with_the_known_ones(package):
    with pytest.raises(InputError, match=r"neither a file nor the name.*choose 'good'"):
        bundled.find_weights("better")


def test_damaged_and_missing_files_are_refused(package):
    (package / "good.safetensors").write_bytes(b"other")
    with pytest.raises(InputError, match="differs from the shipped file"):
        bundled.find_weights("good")
    (package / "good.safetensors").unlink()
    with pytest.raises(InputError, match="is missing"):
        bundled.find_weights("good")

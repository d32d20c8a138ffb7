"""Weights in the package: their checksums, their cards, and how they are found."""

import hashlib
import json

import pytest

from occjax.errors import InputError
from occjax.models import bundled
from occjax.models.weights import load_weights


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package with one file of weights."""
    (tmp_path / "good.safetensors").write_bytes(b"weights")
    entry = {
        "name": "good",
        "summary": "for tests",
        "sha256": hashlib.sha256(b"weights").hexdigest(),
    }
    (tmp_path / "index.json").write_text(json.dumps([entry]))
    monkeypatch.setattr(bundled, "FOLDER", tmp_path)
    bundled.bundled_weights.cache_clear()
    yield tmp_path
    bundled.bundled_weights.cache_clear()


def test_all_that_is_shipped_is_whole_described_and_readable():
    names = set()
    for weights in bundled.bundled_weights():
        weights.verify()
        assert "licence" in weights.card.read_text(encoding="utf-8").lower()
        load_weights(weights.path)
        names.add(weights.name)
    files = {file.stem for file in bundled.FOLDER.glob("*.safetensors")}
    assert files == names
    assert sum(file.stat().st_size for file in bundled.FOLDER.iterdir()) <= 12e6


def test_weights_are_found_by_name(package):
    assert bundled.find_weights("good") == package / "good.safetensors"


def test_weights_are_found_by_the_name_that_an_estimate_prints(package, tmp_path, monkeypatch):
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    assert bundled.find_weights("good.safetensors") == package / "good.safetensors"
    mine = tmp_path / "empty" / "good.safetensors"
    mine.write_bytes(b"mine")
    assert bundled.find_weights("good.safetensors").resolve() == mine  # what is here comes first


def test_a_path_is_taken_as_it_is(package, tmp_path):
    assert bundled.find_weights(tmp_path / "mine.safetensors") == tmp_path / "mine.safetensors"


def test_an_unknown_name_is_told_with_those_that_there_are(package):
    with pytest.raises(InputError, match=r"no weights of this name.*there are good"):
        bundled.find_weights("better")


def test_a_changed_file_is_refused(package):
    (package / "good.safetensors").write_bytes(b"other")
    with pytest.raises(InputError, match="not the file that was shipped"):
        bundled.find_weights("good")
    (package / "good.safetensors").unlink()
    with pytest.raises(InputError, match="is missing"):
        bundled.find_weights("good")

"""Short form of the fuzzing; ``python -m tests.fuzz`` is the long one."""

import hypothesis
import hypothesis.strategies as st
import pytest

from tests.fuzz.edits import apply, random_edits
from tests.fuzz.readers import READERS, outcome

pytestmark = pytest.mark.usefixtures("unchecked")

CASES = 500


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_damaged_files_are_read_or_refused(tmp_path, reader):
    reader.folder(tmp_path)
    for valid in reader.seeds:
        assert outcome(reader, tmp_path, valid) in ("accepted", "refused")

    @hypothesis.settings(max_examples=CASES, derandomize=True, database=None, deadline=5000)
    @hypothesis.given(st.sampled_from(reader.seeds), st.integers(0, 2**32 - 1))
    def damaged(valid, number):
        data = apply(valid, random_edits(number))
        assert outcome(reader, tmp_path, data) in ("accepted", "refused")

    damaged()

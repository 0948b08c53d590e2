"""What the tests of reports share."""

import pytest

from scenes.sequence import Sequence
from tests.reports.drawn import make_sequence


@pytest.fixture(scope="session")
def sequence(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    return make_sequence(tmp_path_factory.mktemp("sequences") / "arc", 45)

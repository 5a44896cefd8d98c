import pytest
from meshmark_halves import Halves

from meshmark.testing import SegmenterSuite


class TestHalves(SegmenterSuite):
    @pytest.fixture
    def segmenter(self):
        return Halves()

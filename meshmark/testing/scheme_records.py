"""What the suites of both kinds of scheme share: the record of the scheme under test."""

from __future__ import annotations

import re
from typing import Any

import pytest

from meshmark.extension.hookspecs import SchemeRecord


class SchemeRecordSuite:
    """Checks the record of a scheme, if one is offered."""

    @pytest.fixture
    def record(self) -> SchemeRecord | None:
        """Offer the record of the scheme; None leaves out the tests of it."""
        return None

    @pytest.fixture
    def parts(self) -> dict[str, Any]:
        """Offer the `segmenter` and the `solver` the record's factory is called with."""
        return {"segmenter": None, "solver": None}

    def test_record_is_complete(self, record: SchemeRecord | None) -> None:
        """A record names its scheme, says in one line what it does, and has a version."""
        if record is None:
            pytest.skip("no record is offered")
        assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", record.name)
        assert record.summary.strip()
        assert "\n" not in record.summary
        assert record.version

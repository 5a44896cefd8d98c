"""What `meshmark.testing` offers, and what it does not drag in."""

from __future__ import annotations

import subprocess
import sys

import pytest

import meshmark.testing


@pytest.mark.parametrize("name", meshmark.testing.__all__)
def test_every_suite_is_at_the_door(name: str) -> None:
    suite = getattr(meshmark.testing, name)
    assert suite.__name__ == name
    assert any(member.startswith("test_") for member in vars(suite))


def test_what_is_not_offered_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="PoseSuite"):
        _ = meshmark.testing.PoseSuite


def test_meshes_can_be_had_without_pytest() -> None:
    statement = "import sys, meshmark.testing.meshes; sys.exit('pytest' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", statement], check=False, timeout=60)
    assert done.returncode == 0

"""Evidence is that of the file whose hash it bears, whatever happens to the file meanwhile."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from gltf_files import ball
from meshmark.detection import evidence_cache
from meshmark.detection.evidence_cache import EvidenceFile, kept_evidence
from meshmark.errors import InputError, UsageError
from meshmark.extension.recipe import Recipe
from meshmark.testing.meshes import bumpy_sphere

RECIPES = (Recipe("cho2007"),)


@pytest.fixture
def source(tmp_path) -> Path:
    V, F = bumpy_sphere(3, np.eye(3))
    lines = [f"v {x} {y} {z}" for x, y, z in V.astype(np.float32).tolist()]
    lines += [f"f {i} {j} {k}" for i, j, k in (F + 1).tolist()]
    path = tmp_path / "ball.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


def written_anew(path: Path) -> None:
    path.write_text(path.read_text() + "v 0 0 0\n")


def touched(path: Path) -> None:
    path.write_bytes(path.read_bytes())


def exchanged_and_put_back(path: Path) -> None:
    away = path.rename(path.with_suffix(".away"))
    shutil.copy(away, path)
    away.replace(path)


def removed(path: Path) -> None:
    path.unlink()


@pytest.mark.parametrize("change", [written_anew, touched, exchanged_and_put_back, removed])
def test_a_source_that_changes_while_it_is_measured_leaves_no_evidence(
    source, monkeypatch, change
) -> None:
    gather = evidence_cache.gather

    def meanwhile(*args, **options):
        found = gather(*args, **options)
        change(source)
        return found

    evidence = source.with_name("e")
    with monkeypatch.context() as patch:
        patch.setattr(evidence_cache, "gather", meanwhile)
        with pytest.raises(InputError, match=r"ball\.obj: (changed while|cannot be read)"):
            kept_evidence(str(source), EvidenceFile(evidence), recipes=RECIPES)
    assert not evidence.exists()


def test_evidence_of_a_file_that_stays_is_kept_and_is_its_own_only(source) -> None:
    evidence = source.with_name("e")
    measured = kept_evidence(str(source), EvidenceFile(evidence), recipes=RECIPES)
    again = kept_evidence(str(source), EvidenceFile(evidence), recipes=RECIPES)
    assert measured.items[0].chips == again.items[0].chips > 0
    told = kept_evidence(str(source), EvidenceFile(evidence, False), recipes=RECIPES)
    assert (again.authenticated, told.authenticated) == (True, False)
    written_anew(source)
    for authenticated in (True, False):
        with pytest.raises(UsageError, match="another file"):
            kept_evidence(str(source), EvidenceFile(evidence, authenticated), recipes=RECIPES)


def test_evidence_is_that_of_a_clip(tmp_path) -> None:
    made = ball(3)
    made.json["animations"][0]["name"] = "Bend"
    made.json["animations"].append({"channels": [], "samplers": [], "name": "Turn"})
    made.animate(0, "rotation", [0, 0.25], [[0, 0, 0, 1], [0, 0.5, 0, 0.9]])
    source, evidence = str(made.save(tmp_path / "ball.glb")), tmp_path / "e"
    turn = {"clip": "Turn", "fps": 8.0}
    measured = kept_evidence(source, EvidenceFile(evidence), recipes=RECIPES, parameters=turn)
    again = kept_evidence(source, EvidenceFile(evidence), recipes=RECIPES, parameters=turn)
    assert measured.items[0].chips == again.items[0].chips > 0
    np.testing.assert_array_equal(again.items[0].times, [0, 1, 2])
    for other in (None, {"clip": "Bend", "fps": 8.0}):
        with pytest.raises(UsageError, match=r"another clip, .*: clip Turn, fps 8\.0"):
            kept_evidence(source, EvidenceFile(evidence), recipes=RECIPES, parameters=other)


def test_evidence_of_others_is_never_measured(source) -> None:
    with pytest.raises(InputError, match="nowhere"):
        kept_evidence(str(source), EvidenceFile(source.with_name("nowhere"), False))
    assert not source.with_name("nowhere").exists()

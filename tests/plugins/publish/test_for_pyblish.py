"""Real publishes by pyblish: what the integrator copies is marked, or it copies nothing."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from shots import KEY, QUICK, ball, is_marked, key_file, shot, square, tiny, write

import meshmark
from certificates import Holder
from command_line import command
from meshmark.c2pa.checking import check_file
from meshmark.embedding.file import mark_file
from meshmark.embedding.manifest import manifest_path, output_hashes, remark
from meshmark.errors import WorkerError
from meshmark.extension.recipe import Recipe
from meshmark.ledger.moved import Move, moved
from meshmark.ledger.origins import origins
from meshmark.ledger.store import Ledger, init
from meshmark_plugins.publish import marking

api = pytest.importorskip("pyblish.api", reason="pyblish-base is not installed")
import pyblish.util  # noqa: E402

from meshmark_plugins.publish.for_pyblish import MarkMeshes, ValidateCapacity  # noqa: E402

# The importer that pyblish brings is of a kind that Python warns of at every later import, also in
# tests that take warnings for errors. All that it is for is imported by now.
sys.meta_path[:] = [each for each in sys.meta_path if hasattr(each, "find_spec")]


class Studio:
    """A pipeline: instances in, and a folder that the integrator copies to."""

    def __init__(self, folder: Path, patch: pytest.MonkeyPatch) -> None:
        self.folder, self.published = folder, folder / "published"
        self.published.mkdir()
        self.context = api.Context()
        api.deregister_all_plugins()
        api.deregister_all_paths()
        for plugin in (ValidateCapacity, MarkMeshes):
            patch.setattr(plugin, "options", QUICK)
        patch.setattr(MarkMeshes, "key_file", key_file(folder))
        studio = self

        class Integrate(api.InstancePlugin):
            """Copies what an instance has, as integrators do, whatever happened before."""

            order = api.IntegratorOrder

            def process(self, instance):
                if instance.data.get("farm") or not instance.data.get("integrate", True):
                    return
                for each in instance.data["representations"]:
                    names = each["files"]
                    for name in [names] if isinstance(names, str) else names:
                        shutil.copy(Path(each["stagingDir"], name), studio.published / name)
                for source, target in instance.data.get("transfers", []):
                    shutil.copy(source, target)

        # Not in their order: pyblish sorts what is registered.
        for plugin in (Integrate, MarkMeshes, ValidateCapacity):
            api.register_plugin(plugin)

    def add(self, *files: Path, **data: object) -> object:
        instance = self.context.create_instance(files[0].stem, family="usd", **data)
        instance.data["representations"] = [
            {"name": file.suffix[1:], "ext": file.suffix[1:], "files": file.name}
            | {"stagingDir": str(file.parent)}
            for file in files
        ]
        return instance

    def publish(self) -> list[str]:
        """Publish, and return the errors of the report."""
        self.context.data["results"] = []
        pyblish.util.publish(self.context)
        return [str(each["error"]) for each in self.context.data["results"] if each["error"]]

    def there(self) -> list[str]:
        return sorted(path.name for path in self.published.iterdir())


@pytest.fixture
def studio(tmp_path, monkeypatch) -> Iterator[Studio]:
    yield Studio(tmp_path, monkeypatch)
    api.deregister_all_plugins()


@pytest.fixture
def walk(tmp_path) -> Path:
    return shot(tmp_path / "staging" / "walk.usdc")


def test_what_is_integrated_is_marked_and_verified(studio, walk) -> None:
    instance = studio.add(walk, meshmark_recipient="acme")
    assert studio.publish() == []
    assert studio.there() == ["walk.marked.usdc", "walk.marked.usdc.meshmark.json"]
    output = studio.published / "walk.marked.usdc"
    assert is_marked(output)
    assert not is_marked(walk)
    assert remark(output) is None
    [told] = instance.data["meshmark"]
    assert told["marked"]
    assert told["recipient"] == "acme"
    assert told["log10_p"] < -6
    assert json.loads(manifest_path(output).read_text())["recipient"] == "acme"


def test_the_second_publish_of_the_same_does_no_work(studio, walk, monkeypatch) -> None:
    studio.add(walk)
    assert studio.publish() == []
    output = walk.with_name("walk.marked.usdc")
    before = output.read_bytes(), output.stat().st_mtime_ns
    monkeypatch.setattr("meshmark.embedding.file.embed", None)
    studio.context[:] = []
    studio.add(walk)
    assert studio.publish() == []
    assert (output.read_bytes(), output.stat().st_mtime_ns) == before
    # Done again all the same, it is the same.
    monkeypatch.undo()
    monkeypatch.setattr(MarkMeshes, "options", QUICK)
    monkeypatch.setattr(MarkMeshes, "key_file", str(studio.folder / "studio.key"))
    output.unlink()
    studio.context[:] = []
    instance = studio.add(walk)
    assert studio.publish() == []
    assert output.read_bytes() == before[0]
    assert instance.data["meshmark"][0]["assets"] is None


def test_a_retry_with_what_was_marked_does_not_mark_it_again(studio, walk) -> None:
    instance = studio.add(walk)
    assert studio.publish() == []
    before = (studio.published / "walk.marked.usdc").read_bytes()
    # As a farm does that kept the data of the first attempt.
    assert instance.data["representations"][0]["files"] == "walk.marked.usdc"
    assert studio.publish() == []
    assert (studio.published / "walk.marked.usdc").read_bytes() == before
    assert "walk.marked.marked.usdc" not in studio.there()


def test_a_marked_file_is_nobody_elses_copy(studio, walk) -> None:
    instance = studio.add(walk, meshmark_recipient="acme")
    assert studio.publish() == []
    instance.data["meshmark_recipient"] = "globex"
    shutil.rmtree(studio.published)
    studio.published.mkdir()
    assert "is marked for acme, not for globex" in studio.publish()[0]
    assert studio.there() == []


def test_credentials_are_published_with_the_file_they_are_of(studio, walk, monkeypatch) -> None:
    pytest.importorskip("c2pa", reason="c2pa-python is not installed")
    certificates, key = Holder.named("publishing", signs=True).save(studio.folder, "signer")
    signs = {"certificates": str(certificates), "key": str(key)}
    unsigned = studio.add(walk)
    assert studio.publish() == []
    for plugin in (ValidateCapacity, MarkMeshes):
        monkeypatch.setattr(plugin, "options", {**QUICK, "c2pa": signs})
    # What was marked before comes in again, without credentials.
    assert unsigned.data["representations"][0]["files"] == "walk.marked.usdc"
    shutil.rmtree(studio.published)
    studio.published.mkdir()
    assert "is marked, but not signed" in studio.publish()[0]
    assert studio.there() == []
    studio.context[:] = []
    instance = studio.add(walk)
    assert studio.publish() == []
    output, sidecar = studio.published / "walk.marked.usdc", studio.published / "walk.marked.c2pa"
    assert studio.there() == [sidecar.name, output.name, f"{output.name}.meshmark.json"]
    assert not check_file(output, sidecar, certificates).problems
    assert [each["ext"] for each in instance.data["representations"]] == ["usdc", "json", "c2pa"]
    # It is signed already.
    before = sidecar.read_bytes()
    assert studio.publish() == []
    assert sidecar.read_bytes() == before
    assert [each["ext"] for each in instance.data["representations"]] == ["usdc", "json", "c2pa"]


def test_whoever_cannot_sign_publishes_nothing(studio, walk, monkeypatch) -> None:
    pytest.importorskip("c2pa", reason="c2pa-python is not installed")
    for signs, reason in (
        ({"certificates": "nowhere.pem", "key": "nowhere.key"}, "nowhere.pem"),
        ({"certificates": "nowhere.pem"}, "the option c2pa lacks key"),
    ):
        monkeypatch.setattr(MarkMeshes, "options", {**QUICK, "c2pa": signs})
        studio.context[:] = []
        studio.add(walk)
        assert reason in studio.publish()[0]
        assert studio.there() == []


@pytest.mark.slow
def test_a_newer_export_is_marked_anew(studio, walk) -> None:
    studio.add(walk)
    assert studio.publish() == []
    before = (studio.published / "walk.marked.usdc").read_bytes()
    walk.unlink()
    shot(walk, seed=1)
    studio.context[:] = []
    studio.add(walk)
    assert studio.publish() == []
    output = studio.published / "walk.marked.usdc"
    assert output.read_bytes() != before
    assert remark(output) is None


def test_a_newer_export_that_fails_leaves_what_was_marked_before(studio, walk, monkeypatch) -> None:
    studio.add(walk)
    assert studio.publish() == []
    output = walk.with_name("walk.marked.usdc")
    before = output.read_bytes(), manifest_path(output).read_bytes()
    walk.unlink()
    shot(walk, seed=1)
    shutil.rmtree(studio.published)
    studio.published.mkdir()
    monkeypatch.setattr("meshmark.embedding.file.embed", None)
    studio.context[:] = []
    studio.add(walk)
    assert "not callable" in studio.publish()[0]
    assert studio.there() == []
    assert (output.read_bytes(), manifest_path(output).read_bytes()) == before


def test_a_mesh_that_holds_no_mark_stops_before_anything_is_extracted(studio, tmp_path) -> None:
    studio.add(tiny(tmp_path / "staging" / "prop.usdc"))
    [reason] = studio.publish()
    assert "4 points cannot hold 64 bits" in reason
    assert studio.there() == []
    # A validator failed: nothing was run after it.
    assert not (tmp_path / "staging" / "prop.marked.usdc").exists()


@pytest.mark.parametrize("path", ["representations", "transfers"])
def test_without_the_validator_it_does_not_get_to_the_integrator(studio, tmp_path, path) -> None:
    api.deregister_plugin(ValidateCapacity)
    prop = tiny(tmp_path / "staging" / "prop.usdc")
    instance = studio.add(prop)
    if path == "transfers":
        instance.data["representations"] = []
        instance.data["transfers"] = [(str(prop), str(studio.published / "prop.usdc"))]
    [reason] = studio.publish()
    assert "cannot hold 64 bits" in reason
    assert studio.there() == []
    assert instance.data["integrate"] is False
    assert instance.data["representations"] == []


def test_a_waiver_lets_it_pass_and_is_recorded(studio, tmp_path) -> None:
    prop = tiny(tmp_path / "staging" / "prop.usdc")
    instance = studio.add(prop, meshmark_waiver="a placeholder, says Kim")
    assert studio.publish() == []
    assert studio.there() == ["prop.usdc"]
    [told] = instance.data["meshmark"]
    assert not told["marked"]
    assert told["waiver"] == "a placeholder, says Kim"
    assert "cannot hold 64 bits" in told["reason"]


def test_the_ledger_has_marks_and_waivers_once_each(
    studio, walk, tmp_path, monkeypatch, capsys
) -> None:
    where = str(tmp_path / "studio.ledger")
    init(where)
    monkeypatch.setattr(MarkMeshes, "ledger", where)
    for _ in range(2):
        studio.context[:] = []
        studio.add(walk, meshmark_recipient="acme", meshmark_asset="walk", meshmark_version="v2")
        studio.add(tiny(tmp_path / "staging" / "prop.usdc"), meshmark_waiver="says Kim")
        assert studio.publish() == []
    mark, waiver = Ledger(where).entries()
    assert (mark["kind"], mark["asset"], mark["version"]) == ("mark", "walk", "v2")
    assert mark["recipient"] == "acme"
    assert (waiver["kind"], waiver["asset"], waiver["waiver"]) == ("waiver", "prop", "says Kim")
    assert "cannot hold 64 bits" in waiver["reason"]
    assert waiver["source"]["files"] == output_hashes(tmp_path / "staging" / "prop.usdc")
    capsys.readouterr()
    assert command(monkeypatch, "ledger", "list", "--ledger", where) == 0
    assert "for nobody by name, unmarked: says Kim" in capsys.readouterr().out


def test_the_ledger_has_places_that_stay(studio, walk, tmp_path, monkeypatch) -> None:
    where = str(tmp_path / "studio.ledger")
    init(where)
    monkeypatch.setattr(MarkMeshes, "ledger", where)
    run, jump = shot(walk.with_name("run.usdc"), seed=1), shot(walk.with_name("jump.usdc"), seed=2)
    # As AYON's collectors leave it: a folder, or the very file.
    studio.add(walk, publishDir=str(studio.published))
    instance = studio.add(run)
    instance.data["representations"] = []
    instance.data["transfers"] = [(str(run), str(studio.published / "v001_run.usdc"))]
    known = studio.add(jump, publishDir=str(studio.published))
    known.data["representations"][0]["published_path"] = str(studio.published / "v001_jump.usdc")
    for _ in range(2):
        assert studio.publish() == []
    entries = list(Ledger(where).entries())
    assert [Path(entry["output"]) for entry in entries] == [
        studio.published,
        studio.published / "v001_run.usdc",
        studio.published / "v001_jump.usdc",
    ]
    assert "v001_run.usdc" in studio.there()
    # The originals were in the staging folder; whoever keeps them elsewhere says where.
    found = origins(entries)
    assert [origin.source for origin in found] == [walk.resolve(), run.resolve(), jump.resolve()]
    walk.parent.rename(tmp_path / "vault")
    move = Move.of(f"{walk.parent.resolve()}={tmp_path / 'vault'}")
    assert all(moved(origin, [move]).source.is_file() for origin in found)


def test_what_cannot_be_recorded_is_not_published(studio, walk, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(MarkMeshes, "ledger", str(tmp_path / "none.ledger"))
    studio.add(walk)
    studio.add(tiny(tmp_path / "staging" / "prop.usdc"), meshmark_waiver="says Kim")
    assert len(studio.publish()) == 2
    assert studio.there() == []


@pytest.mark.parametrize("error", [WorkerError("a worker process died"), KeyError("a bug")])
def test_an_embedding_that_fails_integrates_nothing(studio, walk, monkeypatch, error) -> None:
    def fail(*args: object, **options: object) -> None:
        raise error

    monkeypatch.setattr("meshmark.embedding.file.embed", fail)
    # Not even with a waiver: it could be marked.
    instance = studio.add(walk, meshmark_waiver="says Kim")
    assert studio.publish() == [str(error)]
    assert studio.there() == []
    assert instance.data["integrate"] is False


def test_what_verifies_badly_is_not_integrated(studio, walk, monkeypatch) -> None:
    real = marking.mark_file

    def weak(*args: object, **options: object):
        manifest = real(*args, **options)
        manifest.document["verification"]["verdict"] = "not marked"
        return manifest

    monkeypatch.setattr(marking, "mark_file", weak)
    studio.add(walk)
    assert "verifies with log10 p" in studio.publish()[0]
    assert studio.there() == []


def test_meshes_in_files_that_cannot_be_marked_stop_it_too(studio, walk) -> None:
    cache = walk.with_name("walk.abc")
    cache.write_bytes(b"Ogawa")
    studio.add(walk, cache)
    [reason] = studio.publish()
    assert "walk.abc: files of this kind cannot be marked" in reason
    assert studio.there() == []
    studio.context[:] = []
    instance = studio.add(walk, cache, meshmark_waiver="nobody gets the cache")
    assert studio.publish() == []
    assert [told["marked"] for told in instance.data["meshmark"]] == [True, False]
    assert "walk.abc" in studio.there()
    assert "walk.usdc" not in studio.there()


def test_a_layer_over_an_unmarked_file_is_not_published(studio, walk) -> None:
    layer = walk.with_name("layer.usda")
    mark_file(walk, layer, KEY, recipe=Recipe("cho2007"))
    studio.add(layer)
    assert "is a layer over an unmarked file" in studio.publish()[0]
    assert studio.there() == []


@pytest.mark.slow
def test_no_mesh_of_a_file_of_another_format_passes_unmarked(studio, tmp_path) -> None:
    scene = tmp_path / "staging" / "set.glb"
    stage = meshmark.read(write(scene.with_suffix(".usdc"), ball(), square()))
    meshmark.write(stage, stage, scene)
    studio.add(scene)
    assert "would be published unmarked: 4 points" in studio.publish()[0]
    assert studio.there() == []
    studio.context[:] = []
    instance = studio.add(scene, meshmark_waiver="the ground, says Kim")
    assert studio.publish() == []
    [told] = instance.data["meshmark"]
    assert told["marked"]
    assert len(told["unmarked"]) == 1


def test_other_files_are_let_be(studio, walk) -> None:
    thumbnail = walk.with_name("walk.jpg")
    thumbnail.write_bytes(b"jpeg")
    texture = walk.with_name("skin.png")
    texture.write_bytes(b"png")
    instance = studio.add(walk, thumbnail)
    instance.data["transfers"] = [(str(texture), str(studio.published / "skin.png"))]
    assert studio.publish() == []
    assert {"walk.jpg", "skin.png", "walk.marked.usdc"} <= set(studio.there())


@pytest.mark.parametrize(
    "data", [{"farm": True}, {"integrate": False}, {"families": ["render"], "family": "render"}]
)
def test_what_is_not_published_here_is_let_be(studio, walk, data) -> None:
    instance = studio.add(walk)
    instance.data.update(data)
    before = dict(instance.data)
    assert studio.publish() == []
    assert instance.data == before
    assert not walk.with_name("walk.marked.usdc").exists()


def test_a_sequence_of_files_is_refused(studio, walk) -> None:
    second = shot(walk.with_name("run.usdc"))
    instance = studio.add(walk)
    instance.data["representations"][0]["files"] = [walk.name, second.name]
    assert "is one of 2 files" in studio.publish()[0]
    assert studio.there() == []


def test_settings_are_attributes_as_ayon_sets_them(studio, walk, monkeypatch) -> None:
    project = {"meshmark": {"publish": {"MarkMeshes": {"recipient": "vendor", "manifests": False}}}}
    for name, value in project[MarkMeshes.settings_category]["publish"]["MarkMeshes"].items():
        monkeypatch.setattr(MarkMeshes, name, value)
    instance = studio.add(walk)
    assert studio.publish() == []
    assert studio.there() == ["walk.marked.usdc"]
    assert instance.data["meshmark"][0]["recipient"] == "vendor"


def test_a_copy_of_the_file_is_found_in_a_folder_of_plugins(studio, walk, tmp_path) -> None:
    api.deregister_plugin(MarkMeshes)
    api.deregister_plugin(ValidateCapacity)
    folder = tmp_path / "plugins"
    folder.mkdir()
    shutil.copy(marking.__file__.replace("marking", "for_pyblish"), folder)
    api.register_plugin_path(str(folder))
    try:
        found = {plugin.__name__: plugin for plugin in api.discover()}
        assert found["ValidateCapacity"].order < found["MarkMeshes"].order < api.IntegratorOrder
    finally:
        api.deregister_plugin_path(str(folder))


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="kills by signal")
def test_a_killed_reader_integrates_nothing(studio, walk, monkeypatch) -> None:
    """The process that reads the file is killed while the publish waits for it."""
    options = {**QUICK, "trusted": False}
    monkeypatch.setattr(ValidateCapacity, "options", options)
    monkeypatch.setattr(MarkMeshes, "options", options)
    studio.add(walk)
    assert studio.publish() == []
    assert "walk.marked.usdc" in studio.there()
    shutil.rmtree(studio.published)
    studio.published.mkdir()
    walk.with_name("walk.marked.usdc").unlink()
    api.deregister_plugin(ValidateCapacity)
    real = subprocess.Popen

    def killed(*args: object, **more: object):
        process = real(*args, **more)
        os.kill(process.pid, signal.SIGKILL)
        return process

    monkeypatch.setattr(subprocess, "Popen", killed)
    studio.context[:] = []
    instance = studio.add(walk)
    [reason] = studio.publish()
    assert "walk.usdc" in reason
    assert "kill" in reason.lower()
    assert studio.there() == []
    assert instance.data["integrate"] is False


@pytest.mark.slow
def test_the_default_layers_are_published(studio, walk, monkeypatch) -> None:
    monkeypatch.setattr(ValidateCapacity, "options", {})
    monkeypatch.setattr(MarkMeshes, "options", {})
    instance = studio.add(walk, meshmark_recipient="acme")
    assert studio.publish() == []
    assert instance.data["meshmark"][0]["marked"]
    assert "walk.marked.usdc" in studio.there()

"""The hook of ShotGrid's publisher, on a small stand-in for what it goes on top of."""

from __future__ import annotations

import logging
import shutil
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest
from shots import KEY, QUICK, is_marked, key_file, shot, tiny

from certificates import Holder
from meshmark.errors import CapacityError, InputError, UsageError
from meshmark.ledger.store import Ledger, init
from meshmark_plugins.publish import marking


class PublishFile:
    """Stands in for the hook that publishes files: it copies what an item's path says."""

    description = "Publishes a file."
    settings = {"Publish Folder": {"type": "string", "default": "", "description": "Where to."}}  # noqa: RUF012
    logger = logging.getLogger("publish")

    def validate(self, settings, item) -> bool:
        return Path(item.properties["path"]).exists()

    def publish(self, settings, item) -> None:
        shutil.copy(item.properties["path"], settings["Publish Folder"].value)


@pytest.fixture
def hook(monkeypatch):
    sgtk = ModuleType("sgtk")
    sgtk.get_hook_baseclass = lambda: PublishFile
    monkeypatch.setitem(sys.modules, "sgtk", sgtk)
    # By its path, as hooks are.
    spec = spec_from_file_location("hook", Path(marking.__file__).with_name("for_shotgrid.py"))
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    real = marking.mark_file
    monkeypatch.setattr(marking, "mark_file", lambda *a, **k: real(*a, **{**k, "trusted": True}))
    monkeypatch.setattr(marking, "_trusted", lambda options: True)
    return module.MarkMeshes()


@pytest.fixture
def settings(hook, tmp_path) -> dict[str, SimpleNamespace]:
    """Settings as the publisher gives them: defaults, or what is configured."""
    (tmp_path / "published").mkdir()
    values = {
        "Publish Folder": str(tmp_path / "published"),
        "Meshmark Key File": key_file(tmp_path),
        "Meshmark Schemes": QUICK["schemes"],
    }
    return {
        name: SimpleNamespace(value=values.get(name, each["default"]))
        for name, each in hook.settings.items()
    }


def item(path: Path, **properties: str) -> SimpleNamespace:
    return SimpleNamespace(properties={"path": str(path), **properties})


def test_the_hook_below_publishes_the_marked_file(hook, settings, tmp_path) -> None:
    walk = item(shot(tmp_path / "walk.usdc"), meshmark_recipient="acme")
    assert hook.validate(settings, walk)
    hook.publish(settings, walk)
    [published] = (tmp_path / "published").iterdir()
    assert is_marked(published)
    assert walk.properties["meshmark"]["key_id"] == KEY.id
    # What is finalised is what was collected.
    assert walk.properties["path"] == str(tmp_path / "walk.usdc")
    assert "marked" in hook.description


def test_the_ledger_has_the_place_that_the_publisher_tells(hook, settings, tmp_path) -> None:
    init(str(tmp_path / "l"))
    settings["Meshmark Ledger"].value = str(tmp_path / "l")
    place = str(tmp_path / "published" / "walk.v001.usdc")
    hook.publish(settings, item(shot(tmp_path / "walk.usdc"), publish_path=place))
    [entry] = Ledger(str(tmp_path / "l")).entries()
    assert entry["output"] == place


def test_whoever_is_to_sign_must_be_able_to(hook, settings, tmp_path) -> None:
    pytest.importorskip("c2pa", reason="c2pa-python is not installed")
    walk = item(shot(tmp_path / "walk.usdc"))
    settings["Meshmark C2PA Certificates"].value = str(tmp_path / "signer.pem")
    with pytest.raises(UsageError, match="the option c2pa lacks key"):
        hook.publish(settings, walk)
    settings["Meshmark C2PA Key"].value = str(tmp_path / "signer.key")
    assert not hook.validate(settings, walk)
    with pytest.raises(InputError, match=r"signer\.pem"):
        hook.publish(settings, walk)
    Holder.named("publishing", signs=True).save(tmp_path, "signer")
    assert hook.validate(settings, walk)
    hook.publish(settings, walk)
    assert (tmp_path / "walk.marked.c2pa").exists()


def test_what_cannot_be_marked_does_not_get_to_the_hook_below(hook, settings, tmp_path) -> None:
    prop = item(tiny(tmp_path / "prop.usdc"))
    assert not hook.validate(settings, prop)
    with pytest.raises(CapacityError, match="cannot hold 64 bits"):
        hook.publish(settings, prop)
    assert not list((tmp_path / "published").iterdir())


def test_a_waiver_lets_it_pass(hook, settings, tmp_path) -> None:
    prop = item(tiny(tmp_path / "prop.usdc"), meshmark_waiver="a placeholder, says Kim")
    assert hook.validate(settings, prop)
    hook.publish(settings, prop)
    assert [path.name for path in (tmp_path / "published").iterdir()] == ["prop.usdc"]
    assert prop.properties["meshmark"]["waiver"] == "a placeholder, says Kim"


def test_the_hook_below_has_the_first_word(hook, settings, tmp_path) -> None:
    assert not hook.validate(settings, item(tmp_path / "nowhere.usdc"))
    script = tmp_path / "shot.nk"
    script.write_text("Root {}")
    assert hook.validate(settings, item(script))
    hook.publish(settings, item(script))
    assert [path.name for path in (tmp_path / "published").iterdir()] == ["shot.nk"]

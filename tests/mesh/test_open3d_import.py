"""A missing library of the system is one clear line, not a traceback."""

from __future__ import annotations

import ctypes
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from meshmark import system_libraries
from meshmark.errors import PluginError
from meshmark.mesh import open3d_import
from meshmark.system_libraries import LIBRARY_PACKAGES, missing_libraries, packages_of


@pytest.fixture(autouse=True)
def _door_not_opened_yet():
    open3d_import.load_open3d.cache_clear()
    yield
    open3d_import.load_open3d.cache_clear()


def break_import(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    def import_module(name: str) -> object:
        raise error

    monkeypatch.setattr(importlib, "import_module", import_module)


def hide(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    real = ctypes.CDLL

    def load(name: str) -> object:
        if name in names:
            raise OSError(f"{name}: cannot open shared object file: No such file or directory")
        return real(None)

    monkeypatch.setattr(system_libraries.ctypes, "CDLL", load)
    monkeypatch.setattr(system_libraries.sys, "platform", "linux")


def test_open3d_comes_through_the_door() -> None:
    assert open3d_import.load_open3d().__name__ == "open3d"


def test_plots_are_imported_when_they_are_called_for(monkeypatch: pytest.MonkeyPatch) -> None:
    open3d = open3d_import.load_open3d()
    open3d_import._plots.cache_clear()
    # Whoever imported open3d before this process came here has the real ones.
    monkeypatch.delitem(sys.modules, open3d_import.PLOTS, raising=False)
    with open3d_import._plots_put_off():
        plots = importlib.import_module(open3d_import.PLOTS)
    assert not hasattr(plots, "__path__")
    figure = plots.get_plotly_fig([open3d.geometry.TriangleMesh.create_box()])
    assert type(figure).__name__ == "Figure"
    assert sys.modules[open3d_import.PLOTS].get_plotly_fig.__module__ == open3d_import.PLOTS


@pytest.mark.slow
def test_no_web_server_is_imported_with_open3d_but_can_be_after_it() -> None:
    script = (
        "import sys; from meshmark.mesh.open3d_import import load_open3d; load_open3d(); "
        "assert not {'dash', 'plotly', 'IPython'} & set(sys.modules), sorted(sys.modules); "
        "import dash; assert dash.Dash; "
        "from open3d.visualization import draw_plotly; assert callable(draw_plotly)"
    )
    subprocess.run([sys.executable, "-c", script], check=True)


def test_missing_library_names_the_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    hide(monkeypatch, "libusb-1.0.so.0", "libEGL.so.1")
    break_import(monkeypatch, ImportError("libusb-1.0.so.0: cannot open shared object file"))
    with pytest.raises(PluginError) as caught:
        open3d_import.load_open3d()
    assert "apt-get install libegl1 libusb-1.0-0" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_package_is_not_blamed_on_the_system(monkeypatch: pytest.MonkeyPatch) -> None:
    hide(monkeypatch, "libEGL.so.1")
    break_import(monkeypatch, ModuleNotFoundError("No module named 'open3d'"))
    with pytest.raises(PluginError, match="No module named 'open3d'") as caught:
        open3d_import.load_open3d()
    assert "apt-get" not in str(caught.value)


def test_other_reasons_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    hide(monkeypatch)
    break_import(monkeypatch, ImportError("libstdc++.so.6: version `GLIBCXX_9' not found\nmore"))
    with pytest.raises(PluginError, match="GLIBCXX_9") as caught:
        open3d_import.load_open3d()
    assert "\n" not in str(caught.value)


def test_only_what_the_linker_lacks_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    hide(monkeypatch, "libGL.so.1")
    assert missing_libraries() == ["libGL.so.1"]
    assert packages_of(missing_libraries()) == ["libgl1"]


def test_other_systems_bring_all_that_is_needed(monkeypatch: pytest.MonkeyPatch) -> None:
    hide(monkeypatch, *LIBRARY_PACKAGES)
    monkeypatch.setattr(system_libraries.sys, "platform", "darwin")
    assert missing_libraries() == []


def test_can_be_asked_before_anything_is_installed() -> None:
    # -I -S: neither the package nor any other is on the path.
    script = Path(system_libraries.__file__)
    done = subprocess.run(
        [sys.executable, "-I", "-S", str(script)], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == packages_of(missing_libraries())

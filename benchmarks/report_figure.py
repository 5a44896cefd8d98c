"""Takes the picture of docs/report.md, and prints what a screen reader gets of the page.

    python benchmarks/report_figure.py [-o FOLDER]

The demonstration's creature is marked for a recipient, treated by a thief, and reported on. The
page is opened by a Chromium of the system.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from io import BytesIO
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

from measuring import REPOSITORY
from meshmark import Key
from meshmark.demo.build import write_creature

NAMES = ("chromium", "chromium-browser", "google-chrome")
WIDTH, HEIGHT = 1000, 1640


def meshmark(*words: str, folder: Path) -> None:
    """Run a command, and show it."""
    print("$ meshmark", *words)
    subprocess.run([sys.executable, "-m", "meshmark", *words], cwd=folder, check=True)


def report(folder: Path) -> Path:
    """Mark the creature, add noise to the copy, and report on that."""
    write_creature(folder / "creature.usdc")
    # A fixed key, so that every run is the same run.
    Key(bytes(range(32))).save(folder / "studio.key")
    key = ("--key", "studio.key")
    copy = ("-o", "for-acme.usdc", "--recipient", "Acme Pictures", "--master", "master.usdc")
    meshmark("embed", "creature.usdc", *key, *copy, "--deliver", folder=folder)
    attack = ("-p", "amplitude=0.001", "--seed", "1")
    meshmark("attack", "noise", "for-acme.usdc", "-o", "leaked.usdc", *attack, folder=folder)
    (folder / "names.txt").write_text("Acme Pictures\nGlobex\nInitech\n", encoding="utf-8")
    beside = ("--original", "creature.usdc", "--master", "master.usdc", "--recipient", "@names.txt")
    meshmark("report", "leaked.usdc", *key, *beside, "-o", "leaked.html", folder=folder)
    return folder / "leaked.html"


def look(page: Path, picture: Path) -> str:
    """Take a picture of the upper part of a page; return what a screen reader gets."""
    program = next(filter(None, map(shutil.which, NAMES)))
    # In containers there is no sandbox, and the page is our own.
    options = ["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-sandbox"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=options)
        view = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        view.goto(page.as_uri())
        view.wait_for_function("document.getElementById('view').dataset.drawn > 0")
        shot = view.screenshot()
        heard = view.locator("body").aria_snapshot()
        browser.close()
    # A palette is enough for a page, and takes a third of the room.
    Image.open(BytesIO(shot)).quantize(256).save(picture, optimize=True)
    return heard


def main() -> None:
    """Write the picture, and print the rest."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=REPOSITORY / "docs" / "report")
    folder: Path = parser.parse_args().output
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work:
        page = report(Path(work))
        heard = look(page, folder / "page.png")
        print(
            f"\nthe page has {page.stat().st_size:,} bytes; a screen reader gets of it:\n\n{heard}"
        )


if __name__ == "__main__":
    main()

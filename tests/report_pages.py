"""Pages that tests look at, of verdicts and manifests made up for them."""

from __future__ import annotations

from html.parser import HTMLParser

import numpy as np

from meshmark.detection.bit_error_rate import BitErrors
from meshmark.detection.looks import TakenLook
from meshmark.detection.searched import Searched
from meshmark.detection.significance import HypothesisResult
from meshmark.detection.verdict import Named, PooledVerdict, PrimVerdict, Verdict
from meshmark.reporting.copy_facts import Asked

RECIPIENT = "ACME </script><b>& Söhne 影"
HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(1)>\"'&{{ 7*7 }}"


def asked(name: str = "copy.usdc", files: int = 1) -> Asked:
    hashes = tuple((f"copy: {name} {i}", "0" * 64) for i in range(files))
    command, schemes = f"meshmark report {name}", (("apex", "5"), ("relief", "2"))
    return Asked(name, "0123456789abcdef", 1e-6, None, command, hashes, schemes)


def verdict(
    name: str = "copy.usdc",
    *,
    answer: str = "marked",
    log10_p: float = -12.0,
    recipient: str | None = "ACME",
    prims: int = 1,
    frames: int = 3,
) -> Verdict:
    """Make up an answer: two schemes, three names, four candidates, an eighth of the rate."""
    per_frame = np.linspace(log10_p, 0.0, frames)
    errors = BitErrors(np.full(frames, 0.125), np.zeros(frames, dtype=np.int64))
    finding = HypothesisResult(recipient, log10_p, per_frame, errors)
    times = tuple(float(i) for i in range(1, frames + 1))
    found = tuple(
        PrimVerdict(f"/{name}/{i}", "apex", answer, log10_p, recipient, 96, times, finding)
        for i in range(prims)
    )
    named = (Named(recipient, log10_p),) if answer == "marked" else ()
    return Verdict(
        name,
        answer,
        log10_p,
        recipient if answer == "marked" else None,
        1.5,
        found,
        (f"passed over: {name}",),
        recipients=named,
        pooled=(PooledVerdict("apex", 2, -1.0),),
        looks=(TakenLook(("apex",), 1, "none", -0.5), TakenLook(("apex",), 4, "most", log10_p)),
        ended="marked" if answer == "marked" else "all seen",
        searched=(Searched(False, 2, 3, 4, 0.5, 0.125, log10_p),),
    )


class Outline(HTMLParser):
    """What a page holds, as somebody hears it who does not see it: headings, texts, labels."""

    def __init__(self) -> None:
        super().__init__()
        self.heard: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self._silent = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += [(name, value or "") for name, value in attrs]
        told = dict(attrs)
        if "aria-label" in told and "hidden" not in told:
            self.heard.append(told["aria-label"] or "")
        self._silent += tag in ("script", "style")

    def handle_endtag(self, tag: str) -> None:
        self._silent -= tag in ("script", "style")

    def handle_data(self, data: str) -> None:
        if data.strip() and not self._silent:
            self.heard.append(" ".join(data.split()))


def outline(text: str) -> Outline:
    parser = Outline()
    parser.feed(text)
    parser.close()
    return parser

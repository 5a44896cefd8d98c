"""Sidecars are signed and checked: what fits is trusted, whatever was changed is named."""

from __future__ import annotations

import time
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa
from cryptography.x509.oid import ExtendedKeyUsageOID

from certificates import Holder
from meshmark.c2pa.checking import Credentials, check_file
from meshmark.c2pa.sidecar import sidecar_path
from meshmark.c2pa.signing import Signer
from meshmark.errors import InputError, MeshmarkError
from time_authority import Authority

RECORD = "0123456789abcdef" * 2
HEADS = [
    b"\xff\xd8\xff\xe0\x00\x10JFIF",
    b"%PDF-1.7",
    b"PK\x03\x04",
    b"\x89PNG\r\n\x1a\n",
    b"<svg ",
]
ALGORITHMS = ["meshmark.apex.4", "meshmark.relief.2"]


@pytest.fixture(scope="module")
def chain() -> list[Holder]:
    """Root, intermediate, and who signs."""
    root = Holder.named("root")
    middle = Holder.named("middle", root)
    return [root, middle, Holder.named("publishing", middle, signs=True)]


@pytest.fixture
def place(tmp_path: Path, chain: list[Holder]) -> Path:
    """A folder with a file, its sidecar, and the root."""
    (tmp_path / "root.pem").write_bytes(chain[0].pem)
    (tmp_path / "copy.usda").write_bytes(b"#usda 1.0\n" * 100)
    sign(tmp_path / "copy.usda", chain[2])
    return tmp_path


def sign(file: Path, holder: Holder, tsa: str | None = None) -> Signer:
    signer = Signer.of(*holder.save(file.parent, "signer"), tsa)
    sidecar_path(file).write_bytes(signer.sidecar(file, RECORD, ALGORITHMS))
    return signer


def checked(place: Path, anchors: str | None = "root.pem") -> Credentials:
    file = place / "copy.usda"
    return check_file(file, sidecar_path(file), None if anchors is None else place / anchors)


def refused(*arguments: Any) -> MeshmarkError:
    with pytest.raises(MeshmarkError) as caught:
        Signer.of(*arguments)
    assert "\n" not in str(caught.value)
    return caught.value


def test_what_was_signed_is_trusted(place: Path) -> None:
    found = checked(place)
    assert (found.problems, found.trusted) == ((), True)
    assert (found.signer, found.issuer) == ("publishing", "Studio")
    assert found.bindings == tuple((name, RECORD) for name in ALGORITHMS)
    assert found.records == (RECORD,)
    assert found.stamped is None


def test_any_flipped_byte_of_the_file_is_seen(place: Path) -> None:
    content = (place / "copy.usda").read_bytes()
    for at in (0, len(content) // 2, len(content) - 1):
        flipped = bytearray(content)
        flipped[at] ^= 1
        (place / "copy.usda").write_bytes(flipped)
        assert checked(place).problems == ("this is not the file that was signed",)
    (place / "copy.usda").write_bytes(content + b"\n")
    assert checked(place).problems == ("this is not the file that was signed",)


def test_any_flipped_byte_of_the_sidecar_is_seen(place: Path) -> None:
    content, whole = (place / "copy.c2pa").read_bytes(), checked(place)
    harmless = 0
    for at in range(0, len(content), 97):
        flipped = bytearray(content)
        flipped[at] ^= 1
        (place / "copy.c2pa").write_bytes(flipped)
        try:
            found = checked(place)
        except InputError:
            continue
        assert found.problems or found == whole, at
        harmless += found == whole
    # A third of it is padding that nobody reads.
    assert harmless < len(content) / 97 / 2


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_what_is_no_sidecar_is_refused_whatever_it_holds(place: Path, seed: int) -> None:
    rng, content = np.random.default_rng(seed), (place / "copy.c2pa").read_bytes()
    file, told = (place / "copy.usda").read_bytes(), set()
    for _ in range(600 if seed else 100):
        start, end = np.sort(rng.integers(len(content), size=2)).tolist()
        broken, other = [
            (content[:start], file),
            (content[:start] + content[end:], file),
            (content[:end] + content[start:], file),
            (content[:start] + rng.bytes(4) + content[start + 4 :], file),
            (content[:start] + b"\xff\xff\xff\xff" + content[start + 4 :], file),
            # Other formats are known to the library, and would be taken apart.
            (content, HEADS[int(rng.integers(len(HEADS)))] + rng.bytes(end)),
        ][int(rng.integers(6))]
        (place / "copy.c2pa").write_bytes(broken)
        (place / "copy.usda").write_bytes(other)
        try:
            found = checked(place)
        except InputError as error:
            told.add(error.message)
            continue
        assert other == file or found.problems
        assert found.problems or found.records == (RECORD,)
    assert told
    assert not [each for each in told if "\n" in each]


def test_nobody_is_trusted_by_default(place: Path) -> None:
    found = checked(place, None)
    assert (found.problems, found.trusted) == ((), False)
    (place / "other.pem").write_bytes(Holder.named("root").pem)
    found = checked(place, "other.pem")
    assert (found.problems, found.trusted) == ((), False)


def test_what_is_no_certificate_is_refused(place: Path) -> None:
    (place / "none.pem").write_bytes(b"none")
    with pytest.raises(InputError, match="holds no certificates"):
        checked(place, "none.pem")
    assert "holds no certificates" in refused(place / "none.pem", place / "signer.key").message
    assert "no private key" in refused(place / "signer.pem", place / "none.pem").message
    assert refused(place / "nowhere.pem", place / "signer.key").exit_code == 3


def test_who_cannot_sign_is_told_before(place: Path, chain: list[Holder]) -> None:
    signs: dict[str, Any] = {"issuer": chain[1], "signs": True}
    past = Holder.named("past", **signs, seconds=(-200, -100))
    assert "not valid at time" in refused(*past.save(place, "past")).message
    future = Holder.named("future", **signs, seconds=(100, 200))
    assert "not valid at time" in refused(*future.save(place, "future")).message
    other = Holder.named("web", **signs, usage=ExtendedKeyUsageOID.SERVER_AUTH)
    assert "invalid" in refused(*other.save(place, "web")).message
    error = refused(place / "signer.pem", place / "past.key")
    assert "is not the key of the first certificate" in error.message
    assert error.source == str(place / "past.key")
    (place / "locked.key").write_bytes(chain[2].key_pem(b"password"))
    assert "password" in refused(place / "signer.pem", place / "locked.key").message
    curve = Holder.named("curve", **signs, key=ec.generate_private_key(ec.SECP256K1()))
    assert "is no key for ES256" in refused(*curve.save(place, "curve")).message
    assert refused(place / "signer.pem", place / "signer.key", "ftp://tsa").exit_code == 2


def test_the_key_is_nowhere(place: Path, chain: list[Holder]) -> None:
    signer = Signer.of(place / "signer.pem", place / "signer.key")
    secret = chain[2].key_pem().decode().splitlines()[1]
    assert secret in signer.key.decode()
    assert secret not in repr(signer)


@pytest.mark.slow
@pytest.mark.parametrize(
    "key",
    [
        ec.generate_private_key(ec.SECP384R1()),
        ec.generate_private_key(ec.SECP521R1()),
        ed25519.Ed25519PrivateKey.generate(),
        rsa.generate_private_key(65537, 2048),
    ],
    ids=["es384", "es512", "ed25519", "ps256"],
)
def test_every_algorithm_signs(place: Path, chain: list[Holder], key: Any) -> None:
    sign(place / "copy.usda", Holder.named("other", chain[1], signs=True, key=key))
    assert checked(place).trusted


@pytest.mark.slow
def test_what_has_expired_needs_a_time_stamp(place: Path, chain: list[Holder]) -> None:
    authority = Authority.founded(place / "tsa", "authority")
    both = (chain[0].pem + authority.root.read_bytes()).decode()
    (place / "both.pem").write_text(both)
    stamped = place / "stamped"
    stamped.mkdir()
    (stamped / "copy.usda").write_bytes((place / "copy.usda").read_bytes())
    brief = Holder.named("brief", chain[1], signs=True, seconds=(-10, 8))
    sign(place / "copy.usda", brief)
    with authority.serving() as url:
        sign(stamped / "copy.usda", brief, url)
    assert checked(place).trusted
    left = brief.certificate.not_valid_after_utc - datetime.now(UTC)
    time.sleep(left.total_seconds() + 1.0)
    [problem] = checked(place).problems
    assert "the certificate has expired" in problem
    found = check_file(stamped / "copy.usda", stamped / "copy.c2pa", place / "both.pem")
    assert (found.problems, found.trusted) == ((), True)
    assert found.stamped is not None
    assert (
        "expired"
        in check_file(stamped / "copy.usda", stamped / "copy.c2pa", place / "root.pem").problems[0]
    )


@pytest.mark.slow
def test_an_authority_that_does_not_answer_is_told_of(place: Path, chain: list[Holder]) -> None:
    files = chain[2].save(place, "signer")
    signer = Signer.of(*files, "http://127.0.0.1:1/")
    with pytest.raises(InputError, match="nothing can be signed with it"):
        signer.sidecar(place / "copy.usda", RECORD, ALGORITHMS)

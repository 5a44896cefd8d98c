"""Certificates and private keys, out of PEM files."""

from __future__ import annotations

from pathlib import Path

from cryptography import x509
from cryptography.exceptions import UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    PublicFormat,
    load_pem_private_key,
)

from meshmark.errors import InputError
from meshmark.files.reading import read_small

# Bytes of a file.
LARGEST = 1 << 20
CURVES = {"secp256r1": "es256", "secp384r1": "es384", "secp521r1": "es512"}

PrivateKey = ec.EllipticCurvePrivateKey | ed25519.Ed25519PrivateKey | rsa.RSAPrivateKey


def read_certificates(path: Path) -> list[x509.Certificate]:
    """Read certificates, in the order of the file.

    Raises
    ------
    InputError
        If the file cannot be read, or holds none.
    """
    try:
        return x509.load_pem_x509_certificates(read_small(path, LARGEST))
    except ValueError:
        raise InputError("holds no certificates in PEM", source=path) from None


def read_private_key(path: Path) -> tuple[PrivateKey, str]:
    """Read a private key, and tell the C2PA algorithm that signs with it.

    Raises
    ------
    InputError
        If the file cannot be read, or the key is none that C2PA allows. Nothing of it is told.
    """
    content = read_small(path, LARGEST)
    try:
        key = load_pem_private_key(content, None)
    except TypeError:
        raise InputError(
            "is protected by a password; `openssl pkey` takes it off", source=path
        ) from None
    except (ValueError, UnsupportedAlgorithm):
        raise InputError("is no private key in PEM", source=path) from None
    if isinstance(key, ed25519.Ed25519PrivateKey):
        return key, "ed25519"
    if isinstance(key, rsa.RSAPrivateKey):
        return key, "ps256"
    if isinstance(key, ec.EllipticCurvePrivateKey) and key.curve.name in CURVES:
        return key, CURVES[key.curve.name]
    raise InputError("is no key for ES256, ES384, ES512, PS256 or Ed25519", source=path)


def belongs(key: PrivateKey, certificate: x509.Certificate) -> bool:
    """Tell whether a certificate is of a key."""
    form = (Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
    public = certificate.public_key().public_bytes(*form)
    return public == key.public_key().public_bytes(*form)


def as_pem(certificates: list[x509.Certificate]) -> bytes:
    """Write certificates one after the other."""
    return b"".join(each.public_bytes(Encoding.PEM) for each in certificates)


def key_as_pem(key: PrivateKey) -> bytes:
    """Write a private key in the form that c2pa-rs reads, PKCS #8."""
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())

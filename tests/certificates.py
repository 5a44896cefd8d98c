"""Certificates of the tests' own, as C2PA wants them."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import (
    BestAvailableEncryption,
    Encoding,
    NoEncryption,
    PrivateFormat,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

EMAIL = ExtendedKeyUsageOID.EMAIL_PROTECTION


@dataclass(frozen=True)
class Holder:
    """A certificate, its private key, and who stands above it."""

    certificate: x509.Certificate
    key: Any
    issuer: Holder | None = None

    @classmethod
    def named(
        cls,
        name: str,
        issuer: Holder | None = None,
        *,
        signs: bool = False,
        usage: x509.ObjectIdentifier | None = EMAIL,
        seconds: tuple[float, float] = (-86400, 86400),
        key: Any = None,
    ) -> Holder:
        """Make one that signs files, or one that signs certificates; valid from now on."""
        key = key or ec.generate_private_key(ec.SECP256R1())
        above = issuer.key if issuer else key
        subject = x509.Name(
            [
                x509.NameAttribute(NameOID.ORGANIZATION_NAME, "Studio"),
                x509.NameAttribute(NameOID.COMMON_NAME, name),
            ]
        )
        first, last = (datetime.now(UTC) + timedelta(seconds=each) for each in seconds)
        for_keys = x509.AuthorityKeyIdentifier.from_issuer_public_key(above.public_key())
        may = [signs, *[False] * 4, not signs, not signs, False, False]
        builder = (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(issuer.certificate.subject if issuer else subject)
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(first)
            .not_valid_after(last)
            .add_extension(x509.BasicConstraints(ca=not signs, path_length=None), critical=True)
            .add_extension(x509.KeyUsage(*may), critical=True)
            .add_extension(
                x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False
            )
            .add_extension(for_keys, critical=False)
        )
        if signs and usage is not None:
            builder = builder.add_extension(x509.ExtendedKeyUsage([usage]), critical=False)
        return cls(builder.sign(above, hashes.SHA256()), key, issuer)

    def save(self, folder: Path, name: str) -> tuple[Path, Path]:
        """Write its chain without the root, and its key."""
        chain, holder = b"", self
        while holder.issuer is not None:
            chain += holder.certificate.public_bytes(Encoding.PEM)
            holder = holder.issuer
        certificates, key = folder / f"{name}.pem", folder / f"{name}.key"
        certificates.write_bytes(chain or self.pem)
        key.write_bytes(self.key_pem())
        return certificates, key

    @property
    def pem(self) -> bytes:
        return self.certificate.public_bytes(Encoding.PEM)

    def key_pem(self, password: bytes | None = None) -> bytes:
        protection = BestAvailableEncryption(password) if password else NoEncryption()
        return self.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, protection)

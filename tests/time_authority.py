"""A time-stamping authority of the tests' own: certificates and replies by openssl, over HTTP."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

CONFIGURATION = """
[req]
distinguished_name = name
prompt = no
[name]
CN = {name}
[root]
basicConstraints = critical, CA:true
keyUsage = critical, keyCertSign
subjectKeyIdentifier = hash
[stamping]
basicConstraints = critical, CA:false
keyUsage = critical, digitalSignature
extendedKeyUsage = critical, timeStamping
[tsa]
default_tsa = stamps
[stamps]
serial = serial
signer_cert = tsa.pem
signer_key = tsa.key
default_policy = 1.2.3.4.1
digests = sha256, sha512
signer_digest = sha256
ess_cert_id_alg = sha256
"""


@dataclass(frozen=True)
class Authority:
    """One that stamps whatever it is asked to."""

    folder: Path

    @classmethod
    def founded(cls, folder: Path, name: str) -> Authority:
        if shutil.which("openssl") is None:
            pytest.skip("openssl is not installed")
        one = cls(folder)
        folder.mkdir()
        (folder / "conf").write_text(CONFIGURATION.format(name=name))
        (folder / "serial").write_text("01\n")
        new = ("-newkey", "rsa:2048", "-nodes", "-config", "conf")
        one.run("req", "-x509", *new, "-extensions", "root", "-keyout", "root.key", "-out", ROOT)
        subject = ("-subj", f"/CN={name} stamps", "-keyout", "tsa.key", "-out", "tsa.csr")
        one.run("req", "-new", *new, *subject)
        signing = ("-CA", ROOT, "-CAkey", "root.key", "-set_serial", "7")
        kind = ("-extfile", "conf", "-extensions", "stamping")
        one.run("x509", "-req", "-in", "tsa.csr", *signing, *kind, "-out", "tsa.pem")
        return one

    @property
    def root(self) -> Path:
        return self.folder / ROOT

    def run(self, *words: str) -> str:
        done = subprocess.run(
            ["openssl", *words], cwd=self.folder, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def reply(self, query: bytes) -> bytes:
        (self.folder / "query").write_bytes(query)
        self.run("ts", "-reply", "-config", "conf", "-queryfile", "query", "-out", "reply")
        return (self.folder / "reply").read_bytes()

    @contextlib.contextmanager
    def serving(self) -> Iterator[str]:
        """Answer requests over HTTP."""
        authority = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                assert self.headers["Content-Type"] == "application/timestamp-query"
                query = self.rfile.read(int(self.headers["Content-Length"]))
                answer = b"no" if self.path == "/nonsense" else authority.reply(query)
                self.send_response(500 if self.path == "/broken" else 200)
                self.send_header("Content-Type", "application/timestamp-reply")
                self.end_headers()
                self.wfile.write(answer)

            def log_message(self, *_: object) -> None:
                pass

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}/"
        finally:
            server.shutdown()
            thread.join()
            server.server_close()


ROOT = "root.pem"

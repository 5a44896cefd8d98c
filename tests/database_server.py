"""A PostgreSQL server of the tests' own, in a folder of its own."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

PLACES = "/usr/lib/postgresql/*/bin"
USER = "postgres"


@dataclass
class Server:
    """A server that can be stopped, and started again."""

    programs: Path
    folder: Path
    port: int
    account: dict[str, Any]
    process: subprocess.Popen[bytes] | None = None

    def url(self, name: str = "postgres") -> str:
        return f"postgresql://{USER}@127.0.0.1:{self.port}/{name}"

    def start(self) -> None:
        # The machine stays up when the server is ended: nothing has to be forced to the disk.
        settings = ("max_connections=250", "listen_addresses=127.0.0.1", "fsync=off")
        options = [word for setting in settings for word in ("-c", setting)]
        places = ("-p", str(self.port), "-k", str(self.folder), "-D", str(self.folder / "data"))
        self.process = subprocess.Popen(
            [self.programs / "postgres", *options, *places],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            cwd=self.folder,
            **self.account,
        )
        until = time.monotonic() + 120
        while time.monotonic() < until:
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.port)):
                if self._answers():
                    return
            time.sleep(0.05)
        raise AssertionError("the server does not start")

    def stop(self) -> None:
        """Break every connection at once."""
        if self.process is not None:
            self.process.send_signal(signal.SIGQUIT)
            self.process.wait(timeout=60)
            self.process = None

    def create(self, name: str) -> str:
        """Make a database, and return its URL."""
        self.ask(f'CREATE DATABASE "{name}"')
        return self.url(name)

    def ask(self, statement: str, name: str = "postgres") -> list[tuple[Any, ...]]:
        import psycopg

        with psycopg.connect(self.url(name), autocommit=True) as connection:
            done = connection.execute(statement)
            return done.fetchall() if done.description else []

    def _answers(self) -> bool:
        import psycopg

        try:
            return self.ask("SELECT 1") == [(1,)]
        except psycopg.OperationalError:
            return False


@contextlib.contextmanager
def server() -> Iterator[Server]:
    """Start a server; skip the test where there is none."""
    found = shutil.which("initdb") or next(
        (str(path) for path in sorted(Path("/").glob(f"{PLACES[1:]}/initdb"))), None
    )
    if found is None:
        pytest.skip("PostgreSQL is not installed")
    programs = Path(found).resolve().parent
    folder = Path(tempfile.mkdtemp(prefix="meshmark-postgresql-"))
    account: dict[str, Any] = {}
    if os.geteuid() == 0:
        # It refuses to run as root.
        account = {"user": USER, "group": USER, "extra_groups": []}
        shutil.chown(folder, USER, USER)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    options = ("-U", USER, "-A", "trust", "-E", "UTF8", "--locale=C", "--no-sync")
    try:
        made = subprocess.run(
            [programs / "initdb", "-D", folder / "data", *options],
            capture_output=True,
            text=True,
            check=False,
            cwd=folder,
            **account,
        )
        assert made.returncode == 0, made.stderr
        one = Server(programs, folder, port, account)
        try:
            one.start()
            yield one
        finally:
            one.stop()
    finally:
        shutil.rmtree(folder, ignore_errors=True)

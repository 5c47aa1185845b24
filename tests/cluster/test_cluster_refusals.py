"""What is said of workers of another kind, of a port that no scheduler listens to, and of a scheduler's file."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tactilevision.cluster import connect
from tactilevision.cluster.connect import refusal, versions
from tactilevision.errors import ClusterError, InputError

pytest.importorskip("distributed")


def test_a_worker_without_the_library_is_refused() -> None:
    fault = refusal(versions(), {})
    assert fault is not None
    assert "'none'" in str(fault)
    assert refusal(versions(), versions()) is None


def test_a_worker_without_the_library_says_so() -> None:
    cloudpickle = pytest.importorskip("cloudpickle")
    code = "import sys, pickle; sys.modules['tactilevision'] = None; print(pickle.load(sys.stdin.buffer)())"
    question = cloudpickle.dumps(connect._asking())
    out = subprocess.run([sys.executable, "-c", code], input=question, capture_output=True, check=True)
    assert out.stdout.split() == [b"{}"]


def test_what_answers_but_is_no_scheduler_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connect, "ANSWER_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        where = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(ClusterError, match=r"no Dask scheduler answers .* dashboard has another port"):
            connect.check_cluster(where)


@pytest.mark.parametrize("address", ["tcp://192.0.2.1:8786", "ws://192.0.2.1:8786", "FILE"])
def test_another_machine_is_reached_without_encryption_where_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, address: str
) -> None:
    file, asked = tmp_path / "scheduler.json", list[str]()

    def ended(address: str, **_: object) -> None:
        asked.append(address)
        raise OSError

    async def greeted(address: str) -> None:
        return None

    monkeypatch.setattr("distributed.Client", ended)
    monkeypatch.setattr(connect, "_greet", greeted)
    file.write_text('{"address": "tcp://192.0.2.1:8786"}')
    where = str(file) if address == "FILE" else address
    with pytest.raises(ClusterError, match=r"without encryption.* give insecure:"):
        connect.check_cluster(where)
    assert not asked
    for meant in (f"insecure:{where}", "tls://192.0.2.1:8786", "tcp://127.0.0.1:8786"):
        with pytest.raises(ClusterError, match="no Dask scheduler answers"):
            connect.check_cluster(meant)
    assert len(asked) == 3


def make_certificate(folder: Path) -> dict[str, str]:
    """A certificate for this machine that signs itself, as settings of Dask."""
    openssl = shutil.which("openssl") or pytest.skip("openssl makes the certificate")
    folder.mkdir(exist_ok=True)
    key, certificate = folder / "key.pem", folder / "certificate.pem"
    words = ("-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost", "-keyout", key, "-out")
    name = ("-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1")
    subprocess.run([openssl, "req", "-x509", *words, certificate, *name], check=True, capture_output=True)
    own = {
        f"{who}__{what}": str(path)
        for who in ("SCHEDULER", "WORKER", "CLIENT")
        for what, path in (("KEY", key), ("CERT", certificate))
    }
    settings = {f"TLS__{name}": value for name, value in (own | {"CA_FILE": str(certificate)}).items()}
    return {f"DASK_DISTRIBUTED__COMM__{k}": v for k, v in (settings | {"REQUIRE_ENCRYPTION": "True"}).items()}


@pytest.mark.slow
def test_a_cluster_is_reached_over_tls_by_who_has_the_certificates(tmp_path: Path) -> None:
    settings = make_certificate(tmp_path)
    other = make_certificate(tmp_path / "other")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tls://127.0.0.1:{free.getsockname()[1]}"
    with (tmp_path / "log").open("wb") as log:
        given: dict[str, Any] = {"env": os.environ | settings, "stdout": log, "stderr": log, "cwd": tmp_path}
        words = ["--host", address.rpartition(":")[0], "--port", address.rpartition(":")[2], "--no-dashboard"]
        scheduler = subprocess.Popen([sys.executable, "-m", "dask", "scheduler", *words], **given)
        ends = ["--nthreads", "1", "--no-dashboard", "--no-nanny", "--death-timeout", "60"]
        worker = subprocess.Popen([sys.executable, "-m", "dask", "worker", address, *ends], **given)
    try:
        code = (
            "import tactilevision.cluster.connect as c, tactilevision.cluster.pool as p; c.ANSWER_S = 5\n"
            f"with p.cluster_pool({address!r}) as pool: print(pool.submit(abs, -7).result())"
        )
        asked = [
            subprocess.Popen([sys.executable, "-c", code], env=os.environ | one, text=True, stdout=-1, stderr=-1)
            for one in (settings, other, {})
        ]
        said = [one.communicate(timeout=100) for one in asked]
    finally:
        for process in (worker, scheduler):
            process.terminate()
            process.wait(30)
    assert said[0][0].split() == ["7"], said[0][1]
    assert "no Dask scheduler answers" in said[1][1]
    assert "TLS is not configured here" in said[2][1]


def test_a_scheduler_file_states_an_address(tmp_path: Path) -> None:
    file = tmp_path / "scheduler.json"
    file.write_text('{"address": "tcp://10.0.0.1:8786"}')
    assert connect.address_of(str(file)) == "tcp://10.0.0.1:8786"
    file.write_text('{"id": 3}')
    with pytest.raises(InputError, match="no `address`"):
        connect.address_of(str(file))

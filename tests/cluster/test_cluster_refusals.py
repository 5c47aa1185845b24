"""What is said of workers of another kind, of a port that no scheduler listens to, and of a scheduler's file."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path

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


def test_a_scheduler_file_states_an_address(tmp_path: Path) -> None:
    file = tmp_path / "scheduler.json"
    file.write_text('{"address": "tcp://10.0.0.1:8786"}')
    assert connect.address_of(str(file)) == "tcp://10.0.0.1:8786"
    file.write_text('{"id": 3}')
    with pytest.raises(InputError, match="no `address`"):
        connect.address_of(str(file))

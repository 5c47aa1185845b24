"""The ledger of passports: its hash is that of coreutils, and its old file stays whole whatever happens."""

from __future__ import annotations

import os
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from tactilevision.errors import InputError
from tactilevision.files.ledger import NUMBERS, folder_digest, read_ledger, write_ledger

ROOT = Path(__file__).parents[1]
PRINTED = "find . -type f ! -path '*/.*' | LC_ALL=C sort | xargs -d '\\n' sha256sum | sha256sum"


def entry(sensor: str, sha256: str, E: float | None = 0.2) -> dict[str, Any]:
    numbers = {name: {"value": E} for name in NUMBERS}
    told = {"sensor": sensor, "sha256": sha256, "date": f"2026-01-0{sha256}", "recording": f"r{sha256}"}
    return told | {"numbers": numbers}


def test_a_folders_hash_is_what_coreutils_print(tmp_path: Path) -> None:
    for name in ("b.csv", "a b/x.png", "a.toml", "ä.txt", ".hidden/y"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(name)
    ran = subprocess.run(["sh", "-c", PRINTED], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert folder_digest(tmp_path) == (ran.stdout.split()[0], 4)


def test_sensors_share_a_ledger_and_any_program_reads_it(tmp_path: Path) -> None:
    path = tmp_path / "gels.sqlite"
    assert read_ledger(path, "a") == []
    write_ledger(path, [entry("a", "2"), entry("b", "1")])
    write_ledger(path, [entry("a", "1", None), entry("a", "2", 0.3)])
    assert [one["sha256"] for one in read_ledger(path, "a")] == ["1", "2"]
    with closing(sqlite3.connect(path)) as base:
        rows = base.execute("SELECT sensor, date, youngs_modulus_MPa FROM entries ORDER BY sensor, date")
        assert rows.fetchall() == [("a", "2026-01-01", None), ("a", "2026-01-02", 0.3), ("b", "2026-01-01", 0.2)]
    assert [one.name for one in tmp_path.iterdir()] == ["gels.sqlite"]


def test_another_file_is_no_ledger(tmp_path: Path) -> None:
    path = tmp_path / "gels.sqlite"
    path.write_text("sensor,date")
    with pytest.raises(InputError, match="no ledger"):
        read_ledger(path, "a")
    path.unlink()
    with closing(sqlite3.connect(path)) as base:
        base.execute("CREATE TABLE entries (sensor)")
    for act in (lambda: read_ledger(path, "a"), lambda: write_ledger(path, [entry("a", "1")])):
        with pytest.raises(InputError, match="no ledger"):
            act()
    path.unlink()
    write_ledger(path, [entry("a", str(k % 10)) | {"sha256": str(k)} for k in range(300)])
    whole = path.read_bytes()
    with closing(sqlite3.connect(path)) as base:
        base.execute("CREATE TRIGGER t AFTER INSERT ON entries BEGIN DELETE FROM entries; END")
        base.commit()
    with pytest.raises(InputError, match="no ledger"):
        write_ledger(path, [entry("a", "1")])
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match="ledger is damaged"):
        read_ledger(path, "a")


ACT = """
import os, resource, signal, sys
from pathlib import Path
sys.path.insert(0, sys.argv[3])
from test_ledger import entry
from tactilevision.files import writing
from tactilevision.files.ledger import write_ledger
from tactilevision.errors import OutputError
path = Path(sys.argv[1])
if sys.argv[2] == "full":
    resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
else:
    Path.replace = lambda self, target: os.kill(os.getpid(), signal.SIGKILL)
    os.replace = lambda source, target: os.kill(os.getpid(), signal.SIGKILL)
try:
    write_ledger(path, [entry("b", str(k % 10)) | {"sha256": str(k), "note": "x" * 500} for k in range(300)])
except OutputError as fault:
    sys.exit(str(fault))
"""


@pytest.mark.parametrize("how", ["full", "killed"])
def test_a_full_disk_and_a_killed_run_leave_the_old_ledger_whole(tmp_path: Path, how: str) -> None:
    path = tmp_path / "gels.sqlite"
    write_ledger(path, [entry("a", "1")])
    before = path.read_bytes()
    told = [sys.executable, "-c", ACT, str(path), how, str(ROOT / "tests")]
    ran = subprocess.run(
        told, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, text=True, check=False
    )
    assert ran.returncode == (1 if how == "full" else -9), ran.stderr
    if how == "full":
        assert "cannot be written" in ran.stderr
        assert [one.name for one in tmp_path.iterdir()] == ["gels.sqlite"]
    assert path.read_bytes() == before
    assert len(read_ledger(path, "a")) == 1

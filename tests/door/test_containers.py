"""Logs, data sets and videos of others: bounded in memory and time, and refused in one sentence."""

from __future__ import annotations

import datetime
import decimal
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import hostile_containers as hostile
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from each import each
from wrong_readers import working

from tactilevision.errors import InputError, RecordingError
from tactilevision.files.child import Answers
from tactilevision.recording.images import count_frames, iter_video
from tactilevision.robots.lerobot_dataset import parts, read_dataset
from tactilevision.robots.log_import import ImportSettings, import_log

ROOT = Path(__file__).parents[2]
FIXTURE = ROOT / "tests" / "data" / "lerobot_v3"
TACTILE = "observation.images.tactile"
TABLE = "data/chunk-000/file-000.parquet"
MAX_KB = 400_000  # that the process of the tests may gain


@pytest.fixture
def bounded() -> Iterator[None]:
    """This process stays small too; the child's memory is bounded by the system."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MAX_KB


HOSTILE = [
    (hostile.bag_of_zeros, ".bag", "more memory than"),
    (hostile.mcap_of_zeros, ".mcap", "more memory than"),
    (hostile.mcap_of_packed_messages, ".mcap", "more memory than"),
    (hostile.mcap_of_pictures, ".mcap", "more time than"),
    (hostile.view_without_end, ".db3", "more than tables"),
    (hostile.view_of_gigabytes, ".db3", "more than tables"),
    (hostile.topics_without_end, ".db3", "more than tables"),
    (hostile.calculated_column, ".db3", "more than tables"),
    (hostile.endless_tree, ".db3", "more time than"),
    (hostile.playlist, ".mcap", "by its first bytes"),
]


@each("make, suffix, said", HOSTILE)
def test_a_log_that_unpacks_without_bound_is_refused(
    make: Callable[[Path], None],
    suffix: str,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    bounded: None,
) -> None:
    monkeypatch.setenv("TACTILEVISION_MAX_CHILD_SECONDS", "1")
    monkeypatch.setenv("TACTILEVISION_MAX_CHILD_MB", "300")
    path = tmp_path / f"log{suffix}"
    make(path)
    assert path.stat().st_size < 2_000_000
    with pytest.raises(InputError, match=said) as refused:
        import_log(path, tmp_path / "out", ImportSettings("/camera"))
    assert "\n" not in str(refused.value)
    assert not [left for left in tmp_path.rglob("*") if left.is_file() and left != path]


def test_a_table_that_unpacks_to_gigabytes_is_refused(tmp_path: Path, bounded: None) -> None:
    path = Path(shutil.copy(FIXTURE / TABLE, tmp_path))
    hostile.table_of_gigabytes(path)
    assert path.stat().st_size < 200_000
    with pytest.raises(InputError, match="memory"):
        list(parts(path))


def test_a_table_of_more_episodes_than_it_can_hold_is_refused(tmp_path: Path) -> None:
    root = Path(shutil.copytree(FIXTURE, tmp_path / "set"))
    hostile.table_of_episodes(root / "meta/episodes/chunk-000/file-000.parquet", TACTILE)
    with pytest.raises(InputError, match="more episodes than its size can hold"):
        read_dataset(root, TACTILE)


SOME: dict[str, pa.Array] = {
    "bool": pa.array([True] * 10),
    "float16": pa.array(np.arange(10, dtype=np.float16)),
    "text": pa.array(["7"] * 10),
    "large text": pa.array(["7"] * 10, pa.large_string()),
    "view": pa.array(["7"] * 10, pa.string_view()),
    "binary": pa.array([b"7"] * 10),
    "fixed binary": pa.array([b"7"] * 10, pa.binary(1)),
    "date": pa.array([datetime.date(2026, 1, 1)] * 10),
    "date64": pa.array([datetime.date(2026, 1, 1)] * 10, pa.date64()),
    "time": pa.array([datetime.time(1)] * 10),
    "timestamp": pa.array([datetime.datetime(2026, 1, 1)] * 10),
    "zoned": pa.array([datetime.datetime(2026, 1, 1)] * 10, pa.timestamp("us", "Europe/Berlin")),
    "duration": pa.array([datetime.timedelta(1)] * 10),
    "decimal": pa.array([decimal.Decimal("1.5")] * 10),
    "decimal256": pa.array([decimal.Decimal("1.5")] * 10, pa.decimal256(60, 1)),
    "null": pa.nulls(10),
    "nan": pa.array([float("nan")] * 10),
    "gaps": pa.array([None, 1] * 5),
    "list": pa.array([[1]] * 10),
    "fixed list": pa.array([[1]] * 10, pa.list_(pa.int64(), 1)),
    "struct": pa.array([{"a": 1}] * 10),
    "struct of text": pa.array([{"bytes": "text", "path": ""}] * 10),
    "map": pa.array([[("a", 1)]] * 10, pa.map_(pa.string(), pa.int64())),
    "dictionary": pa.array(["a"] * 10).dictionary_encode(),
    "large": pa.array([2**63] * 10, pa.uint64()),
}


@pytest.fixture(scope="module")
def pictures_set(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set whose pictures are in its table."""
    root = Path(shutil.copytree(FIXTURE, tmp_path_factory.mktemp("types") / "set"))
    info = root / "meta/info.json"
    info.write_text(info.read_text().replace('"dtype": "video"', '"dtype": "image"'))
    return root


@each("kind", list(SOME))
def test_a_column_of_any_other_type_is_named(kind: str, pictures_set: Path) -> None:
    table = pq.read_table(pictures_set / TABLE)
    packed = pa.array([{"bytes": b"", "path": ""}] * len(table))
    whole, found = table.append_column(TACTILE, packed), read_dataset(pictures_set, TACTILE)
    for name in ("episode_index", "timestamp", TACTILE):
        changed = whole.set_column(whole.schema.get_field_index(name), name, SOME[kind])
        pq.write_table(changed, pictures_set / TABLE)
        try:
            with pytest.raises(InputError) as refused:
                list(found.pictures())
        finally:
            pq.write_table(table, pictures_set / TABLE)
        assert "\n" not in str(refused.value)
        assert kind in ("nan", "large", "float16", "null") or name in str(refused.value)


@each("make", [hostile.playlist, hostile.film_list])
def test_a_list_of_files_is_no_video(make: Callable[[Path], None], tmp_path: Path) -> None:
    path = tmp_path / "frames.mp4"
    make(path)
    with pytest.raises(RecordingError, match="cannot be opened"):
        next(iter_video(path, [0]))


@each("size", [0, 1])
def test_a_video_that_states_more_frames_than_it_has_ends(size: int, tmp_path: Path, bounded: None) -> None:
    path = tmp_path / "frames.mp4"
    hostile.film_of_samples(path, 20_000_000, size=size)
    with suppress(InputError):  # too much memory
        assert count_frames(path) < 10


def started(path: Path, what: str) -> tuple[Answers, int]:
    answers = Answers(working, str(path), what, files=[path])
    return answers, int(next(answers)[0])


def gone(process: int) -> bool:
    for _ in range(100):
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.02)
    return False


@each(
    "what, said",
    [
        ("write", "is damaged: OSError"),
        ("memory", "needs more memory than 500 MB"),
        ("files", "is damaged: OSError"),
        ("die", "is damaged, or needs too much memory"),
        ("answer", "is damaged, or needs too much memory"),
        ("words", "is damaged, or needs too much memory"),
        ("object", "is damaged: TypeError"),
        ("work", "more time than"),
    ],
)
def test_a_reader_that_goes_wrong_is_one_error(
    what: str, said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TACTILEVISION_MAX_CHILD_SECONDS", "1")
    path = tmp_path / "file"
    path.write_bytes(b"x")
    answers, _ = started(path, what)
    for _ in range(2):  # and again when it is asked again
        with pytest.raises(InputError, match=said):
            next(answers)
    assert sum(one.stat().st_size for one in tmp_path.iterdir()) == 1


def test_a_child_serves_the_next_file_and_ends_with_its_iterator(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"x")
    first, process = started(path, "end")
    assert list(first) == []
    second, again = started(path, "ask")
    assert again == process
    assert [second.ask(k, k + 1, k + 2)[0] for k in (0, 1, 2, 7, 8)] == [0, 1, 2, 7, 8]
    del second
    assert gone(process)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_all_and_leaves_nothing(number: signal.Signals, tmp_path: Path) -> None:
    hostile.endless_tree(tmp_path / "log.db3")
    code = (
        "import signal, sys\nfrom tactilevision.cli import main\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # a shell's background jobs ignore it
        "sys.argv = 'tactilevision import log.db3 --frames /camera --out out'.split()\nsys.exit(main())"
    )
    about = os.environ | {"PYTHONPATH": str(ROOT), "TACTILEVISION_MAX_CHILD_SECONDS": "1000"}
    run = subprocess.Popen([sys.executable, "-c", code], cwd=tmp_path, env=about, stderr=subprocess.PIPE)
    try:
        while not list(tmp_path.glob("out/*/frames/*00.png")):
            assert run.poll() is None
            time.sleep(0.05)
        (child,) = Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split()
        run.send_signal(number)
        assert b"results written earlier are as they were" in run.communicate(timeout=20)[1]
    finally:
        run.kill()
    assert run.returncode == 128 + number
    assert gone(int(child))
    assert [path.name for path in tmp_path.rglob("*")] == ["log.db3"]


def test_a_killed_parent_takes_its_child_along(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"x")
    code = (
        "import sys\nfrom pathlib import Path\nfrom test_containers import started\n"
        f"print(started(Path({str(path)!r}), 'sleep')[1], flush=True)\nsys.stdin.read()"
    )
    about = os.environ | {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
    run = subprocess.Popen(
        [sys.executable, "-c", code], env=about, stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=ROOT
    )
    assert run.stdout is not None
    child = int(run.stdout.readline())
    run.kill()
    run.communicate()
    assert gone(child)
